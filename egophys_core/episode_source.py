"""Recordings -> episodes, from recorded points or from video: one way for the command line and for the nodes."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.options import choice, switch
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.image_message import COMPRESSED_IMAGE, IMAGE
from egophys_core.perception.options import PerceptionOptions
from egophys_core.perception.perceive import PerceptionReport, perceive
from egophys_core.perception.remarks import Level, Remark, sentences, verdict_of
from egophys_core.perception.report_message import recorded_remarks
from egophys_core.recording import (
    CONTROLLER_TOPIC,
    OBJECT_TOPIC,
    TopicInfo,
    list_topics,
    read_episode,
    write_episode,
)

PERCEPTION_SHARE = 0.5
"""Part of a build's progress bar that perception takes if an episode is from video."""
STAGES = {"camera poses": (0.0, 0.1), "shape": (0.1, 1.0)}
"""Where the stages of perception begin and end in its own progress, by the time they take."""


class Source(StrEnum):
    """What of a recording an episode is made from."""

    AUTO = "auto"
    """The points if the recording has any, else the video."""
    POINTS = "points"
    VIDEO = "video"
    """Also where the recording has points, which are then not read."""


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """The choices that users have; the same names on the command line and as ROS parameters."""

    source: Source = choice(  # noqa: RUF009
        Source.AUTO, doc="what of a recording is used: points, video, or auto: points if it has any, else video"
    )
    force: bool = switch(False, doc="take an episode from a video of which the verdict is poor, too")
    held: bool = switch(False, doc="hands hold the object from the first frame to the last; else that is looked for")
    no_table: bool = switch(False, doc="there is no table; else one is taken to be at z = 0 unless the object hangs")


@dataclass(frozen=True, kw_only=True)
class EpisodeSource:
    """How recordings become episodes."""

    source: Source = Source.AUTO
    force: bool = False
    """Whether poor videos are taken, too."""
    held: bool = False
    """What `Episode.held` is to say, of recorded points."""
    no_table: bool = False
    """The same of `Episode.no_table`."""
    object_topic: str = OBJECT_TOPIC
    """Topic of the object's points."""
    controller_topic: str = CONTROLLER_TOPIC
    """Topic of the points of the hands."""
    perception: PerceptionOptions = field(default_factory=PerceptionOptions)
    """Used for video only, as the board is."""
    board: Board = field(default_factory=Board)


@dataclass(frozen=True, kw_only=True)
class LoadedEpisode:
    """An episode, and what perception has to say of it."""

    episode: Episode
    report: PerceptionReport | None
    """None if the episode was recorded as points."""


def is_video(path: Path, source: EpisodeSource) -> bool:
    """Whether the episode of a recording is to be made from its video.

    Raises:
        RecordingError: not a bag.
    """
    if source.source != Source.AUTO:
        return source.source == Source.VIDEO
    return _shows_video_alone(list_topics(path), source)


def require_episode(path: Path, topics: Sequence[TopicInfo], source: EpisodeSource) -> None:
    """Check that a recording has what an episode is made from.

    Args:
        path: the recording, for the message.
        topics: what is in it (`inspect_recording`).
        source: what of it to use.

    Raises:
        RecordingError: it has no messages on a topic that is needed.
    """
    if source.source == Source.VIDEO or (source.source == Source.AUTO and _shows_video_alone(topics, source)):
        if not any(topic.messages > 0 and topic.type in (COMPRESSED_IMAGE, IMAGE) for topic in topics):
            raise RecordingError(f"{path}: no images; the recording has {_listed(topics)}")
    else:
        require_topic(path, topics, source.object_topic)
        require_topic(path, topics, source.controller_topic)


def require_topic(path: Path, topics: Sequence[TopicInfo], name: str) -> None:
    """Check that a topic is among those of a recording, with messages.

    Raises:
        RecordingError: it is not, or has none; names what there is.
    """
    if not any(topic.name == name and topic.messages > 0 for topic in topics):
        raise RecordingError(
            f"{path}: no messages on {name}; the recording has {_listed(topics)}. Record it, or name the topic "
            "that has the points"
        )


def _listed(topics: Sequence[TopicInfo]) -> str:
    return ", ".join(f"{each.name} ({each.type}, {each.messages} messages)" for each in topics) or "no topics at all"


def _shows_video_alone(topics: Sequence[TopicInfo], source: EpisodeSource) -> bool:
    filled = [topic for topic in topics if topic.messages > 0]
    has_points = any(topic.name in (source.object_topic, source.controller_topic) for topic in filled)
    return not has_points and any(topic.type in (COMPRESSED_IMAGE, IMAGE) for topic in filled)


def load_episodes(
    paths: Sequence[Path],
    source: EpisodeSource,
    *,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> list[LoadedEpisode]:
    """Read or perceive the episode of each recording.

    A perceived episode is what a reader of its recorded points gets, bit for bit: a twin built from it is the twin
    built from a log of it.

    Args:
        paths: `.mcap` or `.db3` files or rosbag2 folders.
        source: what of them to use, and how.
        progress: called with what is being done and the share of all recordings that is done, 0..1; raises to stop.

    Raises:
        RecordingError: not a bag, or the topics are not in it.
        EpisodeError: points or video do not form an episode; or the verdict on the video, or on that from which
            recorded points were perceived, is poor, and that is not forced; or no hand holds the object in it.
    """
    loaded = []
    for index, path in enumerate(paths):

        def report(stage: str, share: float, index: int = index) -> None:
            progress(stage, (index + share) / len(paths))

        report(f"read {path.name}", 0.0)
        loaded.append(_load(path, source, report))
    return loaded


def _load(path: Path, source: EpisodeSource, progress: Callable[[str, float], None]) -> LoadedEpisode:
    if not is_video(path, source):
        if not source.force:
            _require_usable(path, recorded_remarks(path))
        episode = read_episode(path, object_topic=source.object_topic, controller_topic=source.controller_topic)
        declared = dataclasses.replace(episode, held=source.held, no_table=source.no_table)
        return LoadedEpisode(episode=declared, report=None)

    def report(stage: str, share: float) -> None:
        begin, end = STAGES.get(stage, (0.0, 1.0))
        progress(f"perceive: {stage}", begin + (end - begin) * share)

    perceived = perceive(path, options=source.perception, board=source.board, progress=report)
    remarks = perceived.report.remarks
    if len(perceived.episode.controller_ids) == 0:
        why = sentences(remarks, Level.BAD) or "no hand holds the object"
        raise EpisodeError(f"{path.name}: {why}. {_LOOK}; no hand could drive a twin, with --force neither")
    if not source.force:
        _require_usable(path, remarks)
    return LoadedEpisode(episode=_as_recorded(perceived.episode), report=perceived.report)


_LOOK = "`egophys perceive` draws what was seen"


def _require_usable(path: Path, remarks: Sequence[Remark]) -> None:
    if verdict_of(remarks) == "poor":
        raise EpisodeError(
            f"{path.name}: the video is poor: {sentences(remarks, Level.BAD)}. {_LOOK}; film again, or take it all the "
            "same with --force (parameter `force` of twin_node)"
        )


def _as_recorded(episode: Episode) -> Episode:
    """Write the points and read them again: stamps of whole nanoseconds, one kind of NaN, nothing of confidence 0."""
    with TemporaryDirectory(prefix="egophys-") as folder:
        path = Path(folder) / "episode"
        write_episode(episode, path)
        read = read_episode(path, ground_height=episode.ground_height)
    return dataclasses.replace(read, name=episode.name)
