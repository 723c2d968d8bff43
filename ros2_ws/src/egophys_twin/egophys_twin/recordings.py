"""Recordings that jobs learn from, executions of plans among them. Imports no ROS."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from egophys_core.episode import Episode
from egophys_core.episode_source import EpisodeSource, LoadedEpisode, load_episodes, require_episode, require_topic
from egophys_core.errors import OptionsError, RecordingError
from egophys_core.recording import inspect_recording, list_topics
from egophys_twin.executions import execution_episodes, has_executions
from egophys_twin.recorded_topics import source_in, topic_in


def require_recordings(
    paths: Sequence[Path], source: EpisodeSource, *, namespace: str, executed_topic: str | None = None
) -> None:
    """Check that there are recordings, whole and with the topics that episodes are made from.

    Args:
        paths: bags and logs.
        source: how recordings become episodes.
        namespace: of the names of topics, see `recorded_topics`.
        executed_topic: topic of the paths that were executed, in logs that show these; None where they do not count.

    Raises:
        RecordingError: none is given, or one does not exist, is cut or damaged, or lacks a topic.
    """
    if not paths:
        raise RecordingError("no episode given; name at least one recording in episode_paths")
    for path in paths:
        if not path.exists():
            raise RecordingError(f"{path}: no such recording on the machine of the twin node")
        topics = inspect_recording(path)
        here = source_in(topics, source, namespace)
        executed = executed_topic and topic_in(topics, executed_topic, namespace)
        if any(topic.name == executed and topic.messages for topic in topics):
            require_topic(path, topics, here.object_topic)
        else:
            require_episode(path, topics, here)


def require_loads(loads: Sequence[float], paths: Sequence[Path]) -> None:
    """Check that loads, if there are any, are one for each recording.

    Raises:
        OptionsError: they are not, or one is no weight.
    """
    if loads and len(loads) != len(paths):
        raise OptionsError(
            f"{len(loads)} load(s) for {len(paths)} recording(s); give one in newtons for each, 0 where nothing hangs"
        )
    for path, newtons in zip(paths, loads, strict=False):
        if not 0.0 <= newtons < np.inf:
            raise OptionsError(f"the load of {path} must be newtons, not negative, got {newtons}")


def loads_by_name(loads: Sequence[float], episodes: Sequence[Episode]) -> dict[str, float]:
    """N that hang in each episode, by its name; none where none are given.

    Raises:
        OptionsError: a log of several executed plans stands for more episodes than recordings.
    """
    if loads and len(loads) != len(episodes):
        raise OptionsError(
            f"{len(loads)} load(s) for {len(episodes)} episodes: a log of executed plans has one for each of them, and "
            "no markers; leave loads out"
        )
    return {each.name: newtons for each, newtons in zip(episodes, loads, strict=False) if newtons}


def recorded_episodes(
    paths: Sequence[Path], sources: Sequence[EpisodeSource], *, progress: Callable[[str, float], None]
) -> list[LoadedEpisode]:
    """The episode of each recording, by a source of its own; otherwise as `load_episodes`."""
    loaded = []
    for index, (path, source) in enumerate(zip(paths, sources, strict=True)):
        loaded += load_episodes([path], source, progress=_part(progress, index, len(paths)))
    return loaded


def observed_episodes(
    paths: Sequence[Path],
    source: EpisodeSource,
    *,
    executed_topic: str,
    namespace: str = "/",
    grasp: np.ndarray,
    ground_height: float,
    progress: Callable[[str, float], None],
) -> list[Episode]:
    """What was observed: an episode of each plan that a log saw executed, and one of any other recording.

    Args:
        paths: bags and logs.
        source: how recordings become episodes.
        executed_topic: topic of the paths that were executed.
        namespace: of the names of these topics, see `recorded_topics`.
        grasp: [C, 3] metres, the points that move with the tool when it takes hold (`Twin.grasp`).
        ground_height: z of the table, metres; executions do not record it.
        progress: called with what is being done and the share done, 0..1; raises to stop.

    Raises:
        RecordingError: not a bag, or the topics are not in it.
        EpisodeError: the points do not form an episode.
    """
    episodes: list[Episode] = []
    for index, path in enumerate(paths):
        topics = list_topics(path)
        here = source_in(topics, source, namespace)
        executed = topic_in(topics, executed_topic, namespace)
        if has_executions(path, executed):
            progress(f"read {path.name}", index / len(paths))
            episodes += execution_episodes(
                path,
                executed_topic=executed,
                object_topic=here.object_topic,
                grasp=grasp,
                ground_height=ground_height,
            )
        else:
            loaded = load_episodes([path], here, progress=_part(progress, index, len(paths)))
            episodes += [each.episode for each in loaded]
    return _distinct(episodes)


def _part(progress: Callable[[str, float], None], index: int, count: int) -> Callable[[str, float], None]:
    """What tells of the progress of one of so many recordings."""
    return lambda stage, share: progress(stage, (index + share) / count)


def _distinct(episodes: Sequence[Episode]) -> list[Episode]:
    """The episodes with names that tell them apart: recorders call every log alike."""
    names = [each.name for each in episodes]
    return [
        replace(each, name=f"{each.name}_{names[:index].count(each.name) + 1}") if names.count(each.name) > 1 else each
        for index, each in enumerate(episodes)
    ]
