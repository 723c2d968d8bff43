"""Recordings that jobs learn from, executions of plans among them. Imports no ROS."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from egophys_core.episode import Episode
from egophys_core.episode_source import EpisodeSource, load_episodes, require_episode, require_topic
from egophys_core.errors import OptionsError, RecordingError
from egophys_core.recording import inspect_recording
from egophys_twin.executions import execution_episodes, has_executions


def require_recordings(paths: Sequence[Path], source: EpisodeSource, *, executed_topic: str | None = None) -> None:
    """Check that there are recordings, whole and with the topics that episodes are made from.

    Args:
        paths: bags and logs.
        source: how recordings become episodes.
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
        if any(topic.name == executed_topic and topic.messages for topic in topics):
            require_topic(path, topics, source.object_topic)
        else:
            require_episode(path, topics, source)


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


def observed_episodes(
    paths: Sequence[Path],
    source: EpisodeSource,
    *,
    executed_topic: str,
    grasp: np.ndarray,
    ground_height: float,
    progress: Callable[[str, float], None],
) -> list[Episode]:
    """What was observed: an episode of each plan that a log saw executed, and one of any other recording.

    Args:
        paths: bags and logs.
        source: how recordings become episodes.
        executed_topic: topic of the paths that were executed.
        grasp: [C, 3] metres, the points that move with the tool when it takes hold (`Twin.grasp`).
        ground_height: z of the table, metres; executions do not record it.
        progress: called with what is being done and the share done, 0..1; raises to stop.

    Raises:
        RecordingError: not a bag, or the topics are not in it.
        EpisodeError: the points do not form an episode.
    """
    episodes: list[Episode] = []
    for index, path in enumerate(paths):
        if has_executions(path, executed_topic):
            progress(f"read {path.name}", index / len(paths))
            episodes += execution_episodes(
                path,
                executed_topic=executed_topic,
                object_topic=source.object_topic,
                grasp=grasp,
                ground_height=ground_height,
            )
        else:

            def report(stage: str, share: float, index: int = index) -> None:
                progress(stage, (index + share) / len(paths))

            episodes += [each.episode for each in load_episodes([path], source, progress=report)]
    return _distinct(episodes)


def _distinct(episodes: Sequence[Episode]) -> list[Episode]:
    """The episodes with names that tell them apart: recorders call every log alike."""
    names = [each.name for each in episodes]
    return [
        replace(each, name=f"{each.name}_{names[:index].count(each.name) + 1}") if names.count(each.name) > 1 else each
        for index, each in enumerate(episodes)
    ]
