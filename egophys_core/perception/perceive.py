"""Video -> Episode: the whole of perception, on a bag."""

import dataclasses
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from egophys_core.episode import Episode
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.camera_path import CameraPath, find_camera_path
from egophys_core.perception.camera.lens import SquareView
from egophys_core.perception.camera.video import IMAGE_TOPIC, INFO_TOPIC, Video, VideoWarning, open_video
from egophys_core.perception.episode_assembly import EpisodeAssembly
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import ObjectKind, PerceptionOptions, Stages
from egophys_core.perception.remarks import Remark, verdict_of
from egophys_core.perception.scene_observer import SceneObserver
from egophys_core.perception.seconds import Second, SecondsSeen
from egophys_core.perception.stages import View
from egophys_core.perception.verdict import judge


@dataclass(frozen=True, kw_only=True)
class PerceptionReport:
    """What was found, inferred and missing."""

    frames: int
    """Views that were looked at."""
    posed: int
    """Of them, views whose camera pose was found, on the board or on the table."""
    pose_inferred: int
    """Views whose pose was interpolated over a short gap."""
    scale_is_known: bool
    """False without a tag board: lengths are then in units of an assumed height of the camera."""
    kind: str
    """`sheet` or `solid`."""
    thickness_m: float
    """Metres: height of the skin of a sheet over the table at rest; 0 for solids."""
    tracked: int
    """Points of the object."""
    coverage: float
    """0..1: share of (view, point) pairs with a place."""
    hand_seen: int
    """Views in which a hand is seen."""
    grip_frame: int
    """View in which the hand takes hold; -1 if it never does; 0 of learned stages, which need the hand from then on."""
    notes: tuple[str, ...]
    """Sentences for the user: what was inferred or missing, with numbers."""
    seconds: tuple[Second, ...]
    """What was seen in each second of the video."""
    remarks: tuple[Remark, ...]
    """How good that is for a twin, and what to film differently."""
    verdict: str = field(init=False)
    """`good`, `usable` or `poor`: as the worst remark is."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "verdict", verdict_of(self.remarks))


@dataclass(frozen=True, kw_only=True)
class Perceived:
    """An episode from video."""

    episode: Episode
    """Points of the object and of the hand."""
    start_ns: int
    """Header stamp of its first frame, nanoseconds since the epoch."""
    report: PerceptionReport
    """What to know about it."""


def perceive(
    path: Path | str,
    *,
    image_topic: str = IMAGE_TOPIC,
    info_topic: str = INFO_TOPIC,
    options: PerceptionOptions | None = None,
    board: Board | None = None,
    on_observation: Callable[[Observation], None] | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Perceived:
    """Reconstruct the object and the hand of a recorded egocentric video.

    Args:
        path: an `.mcap` or `.db3` file or a rosbag2 folder with an image topic and its camera info.
        image_topic: of the camera's images, compressed or raw.
        info_topic: of its CameraInfo.
        options: the defaults if None.
        board: the printed board on the table; the default board if None.
        on_observation: called with each observation in the order of the stamps, to draw or publish; none is kept.
        progress: called with a stage and the share of it that is done, 0..1.

    Raises:
        RecordingError: not a bag, or no images or camera info in it.
        EpisodeError: no pose of the camera, no object, or it never rests; the message says what to do.
    """
    options, board = options or PerceptionOptions(), board or Board()
    # The matrices are small: threads of the linear algebra wait for each other longer than they work.
    with threadpool_limits(1), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", VideoWarning)
        video = open_video(path, image_topic=image_topic, info_topic=info_topic)
        perceived = _perceive(video, options, board, on_observation or _ignore, progress or _ignore)
    for each in caught:
        warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
    said = dict.fromkeys(str(each.message) for each in caught if issubclass(each.category, VideoWarning))
    report = dataclasses.replace(perceived.report, notes=(*said, *perceived.report.notes))
    return dataclasses.replace(perceived, report=report)


def _ignore(*_: object) -> None:
    """Nobody listens."""


def _perceive(
    video: Video,
    options: PerceptionOptions,
    board: Board,
    on_observation: Callable[[Observation], None],
    tell: Callable[[str, float], None],
) -> Perceived:
    if options.stages == Stages.LEARNED:
        return _perceive_by_learned_stages(video, options, board, on_observation, tell)
    from egophys_core.perception.learned.loading import load_landmarker

    landmarker = load_landmarker(options)
    camera = find_camera_path(video, board, height_m=options.camera_height_m, tell=tell)
    scene = SceneObserver(options, camera.board, landmarker=landmarker)
    assembly = EpisodeAssembly(options=options)
    seen = SecondsSeen(least_confidence=options.least_confidence)

    def take(observations: list[Observation]) -> None:
        for observation in observations:
            assembly.add(observation)
            seen.add(observation)
            on_observation(observation)

    for index, view in enumerate(_views(video, camera, options)):
        take(scene.add(view))
        tell("shape", min((index + 1) / len(camera.stamps_ns), 1.0))
    take(scene.finish())
    assert scene.rest is not None
    episode = assembly.episode(_episode_name(video, camera), ground_height=0.0)
    report = _report_of_scene(camera, scene, assembly, episode, seen)
    return Perceived(episode=episode, start_ns=assembly.start_ns, report=report)


def _perceive_by_learned_stages(
    video: Video,
    options: PerceptionOptions,
    board: Board,
    on_observation: Callable[[Observation], None],
    tell: Callable[[str, float], None],
) -> Perceived:
    # What needs torch is imported where it is asked for; missing weights are found before the work begins.
    from egophys_core.perception.learned.loading import load_stages
    from egophys_core.perception.staged_video import observe_by_stages

    stages = load_stages(options)
    camera = find_camera_path(video, board, height_m=options.camera_height_m, tell=tell)
    tell("shape", 0.0)

    def views() -> Iterator[View]:
        return (view for view in _views(video, camera, options) if np.isfinite(view.world_from_camera).all())

    stamps_ns: list[int] = []
    seen = SecondsSeen(least_confidence=options.least_confidence)

    def take(observation: Observation) -> None:
        stamps_ns.append(observation.view.stamp_ns)
        seen.add(observation)
        on_observation(observation)

    episode, kind = observe_by_stages(
        views, stages, name=_episode_name(video, camera), options=options, on_observation=take
    )
    tell("shape", 1.0)
    report = _report(
        camera,
        episode,
        seen,
        kind=str(kind),
        thickness_m=0.0,
        grip_frame=0,
        still_s=options.still_s,
        notes=(*camera.notes, "learned stages: hand and object are taken to be in view from the first frame on"),
    )
    return Perceived(episode=episode, start_ns=stamps_ns[0], report=report)


def _views(video: Video, camera: CameraPath, options: PerceptionOptions) -> Iterator[View]:
    """Square, upright views with their poses."""
    square = SquareView(video.camera, turns=camera.turns, side=options.side)
    poses = dict(zip(camera.stamps_ns, camera.track.world_from_camera, strict=True))
    for frame in video.frames():
        yield View(
            stamp_ns=frame.stamp_ns,
            image=square.image(frame.image),
            camera_matrix=square.matrix,
            world_from_camera=square.from_raw_pose(poses[frame.stamp_ns]),
        )


def _episode_name(video: Video, camera: CameraPath) -> str:
    """A twin keeps the names of its episodes, so that of the assumed scale tells whoever plans with it."""
    return video.path.resolve().name + ("" if camera.scale_is_known else " (scale assumed)")


def _report_of_scene(
    camera: CameraPath, scene: SceneObserver, assembly: EpisodeAssembly, episode: Episode, seen: SecondsSeen
) -> PerceptionReport:
    assert scene.rest is not None
    rest = scene.rest
    notes = [*camera.notes, *(note for note in (scene.warning, rest.note) if note)]
    left_out = int(np.count_nonzero(camera.track.known)) - episode.frames
    if left_out:
        notes.append(f"{left_out} black frame(s) left out")
    if seen.hand_seen == 0:
        notes.append("no hand was seen: the episode has no controllers, so no twin can be fitted to it")
    elif assembly.grip_frame < 0:
        notes.append("a hand was seen but the object never moved under it: the episode has no controllers")
    if rest.kind == ObjectKind.SOLID:
        notes.append("the hidden side was inferred from symmetry and moves along with the rest of the body")
    return _report(
        camera,
        episode,
        seen,
        kind=str(rest.kind),
        thickness_m=rest.model.thickness,
        grip_frame=assembly.grip_frame,
        still_s=assembly.options.still_s,
        notes=notes,
        rest_px=rest.residual_px,
        choice=scene.warning,
    )


def _report(
    camera: CameraPath,
    episode: Episode,
    seen: SecondsSeen,
    *,
    kind: str,
    thickness_m: float,
    grip_frame: int,
    still_s: float,
    notes: Sequence[str],
    rest_px: float | None = None,
    choice: str = "",
) -> PerceptionReport:
    """The report, with remarks.

    Args:
        still_s: as of `judge`, like `rest_px` and `choice`.
    """
    track, seconds = camera.track, seen.seconds(camera.stamps_ns)
    return PerceptionReport(
        frames=len(track.known),
        posed=int(np.count_nonzero(track.known & ~track.inferred)),
        pose_inferred=int(np.count_nonzero(track.inferred)),
        scale_is_known=camera.scale_is_known,
        kind=kind,
        thickness_m=thickness_m,
        tracked=episode.points.shape[1],
        coverage=float(episode.visible.mean()),
        hand_seen=seen.hand_seen,
        grip_frame=grip_frame,
        notes=tuple(notes),
        seconds=seconds,
        remarks=judge(
            seconds=seconds,
            frames=len(track.known),
            posed=int(np.count_nonzero(track.known)),
            hand_seen=seen.hand_seen,
            has_contact=len(episode.controller_ids) > 0,
            still_s=still_s,
            scale_is_known=camera.scale_is_known,
            rest_px=rest_px,
            lens=camera.lens,
            choice=choice,
        ),
    )
