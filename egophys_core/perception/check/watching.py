"""The part of a video that a check looks at: some thirty views, with camera poses, the object and the hands in them."""

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import islice

import cv2
import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import (
    FEWEST_TAGS,
    FOCAL_TOLERANCE,
    BoardPoseFinder,
    CameraPose,
    NoPose,
    focal_error,
)
from egophys_core.perception.camera.frame_source import FrameSource
from egophys_core.perception.camera.intrinsics_file import scaled
from egophys_core.perception.camera.lens import Camera, FullView, SquareView, upright_turns
from egophys_core.perception.camera.pose_track import LONGEST_FILLED_GAP_S
from egophys_core.perception.camera.tag_edges import TagEdgeFinder
from egophys_core.perception.camera.video import Frame
from egophys_core.perception.check.true_focal import true_focal
from egophys_core.perception.masks.colour_model import is_black
from egophys_core.perception.masks.mask_tracker import MaskTracker
from egophys_core.perception.masks.object_finder import FoundObject, find_object
from egophys_core.perception.options import PerceptionOptions
from egophys_core.perception.scene_observer import board_outline
from egophys_core.perception.stages import Masks, View

VIEWS = 30
"""About as many would be looked at evenly over the video, were it not for the first second."""
STILL_STEP_S = 0.1
"""Time between them where the object should rest."""
GUESSED_FOCAL = 0.8
"""Focal length, share of the image's longer side, of a camera of which nothing is known: a phone's."""

FOCAL_FRAMES = 5
"""Frames in which a doubted focal length is looked for."""
_LARGEST = 1000
"""Pixels: images whose longer side is larger are shrunk to this, which keeps what a square view of 518 shows."""
_TRIES = 12
"""Frames at the start that are looked at one by one for the first with a pose."""
_TOGETHER = 2
"""Frames that are worked on at the same time."""


@dataclass(frozen=True, kw_only=True)
class Watched:
    """What was seen of a video."""

    source: FrameSource
    """The video."""
    board: Board
    """On the table."""
    camera: Camera
    """Of its images as they were looked at: large ones are shrunk."""
    camera_is_guessed: bool
    """Whether no intrinsics were given."""
    fitting_focal_px: float
    """Focal length with which the tags fit; that of the camera unless they speak against it."""
    frames: int
    """Frames there are."""
    seconds: float
    """From the first to the last."""
    looked_s: np.ndarray
    """[L] seconds from the first frame: the frames in which tags were looked for."""
    posed: np.ndarray
    """[L] bool: those in which they gave the camera's place."""
    poses: tuple[CameraPose, ...]
    """Those found."""
    why_no_pose: str
    """The most common reason; empty if all have one."""
    is_mirrored: bool
    """Whether there is no pose, but tags in the mirrored views."""
    views: tuple[View, ...]
    """Square and upright, the first the one in which the object is chosen; without a pose only where none has one."""
    times: np.ndarray
    """[V] seconds from the first frame of the video."""
    tag_blur_px: np.ndarray
    """[V] pixels of the views: standard deviation of the blur of the tags; NaN where there is no pose."""
    found: FoundObject | None
    """The object in the first view."""
    why_no_object: str
    masks: tuple[Masks, ...]
    """Of the views; none without an object."""


def watch(
    source: FrameSource,
    camera: Camera | None,
    board: Board,
    options: PerceptionOptions,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Watched:
    """Look at a video.

    Args:
        source: the video.
        camera: of its images; None: guessed from the tags.
        board: on the table.
        options: of perception; the box or point on the object, the views' side and the time at rest count.
        progress: called with a stage and the share of it that is done.

    Raises:
        RecordingError: the video cannot be read.
        EpisodeError: it has no frames.
    """
    small = _shrunk(source)
    known = guessed_camera(small, board) if camera is None else scaled(camera, small.width, small.height)
    looks = _look(small, known, board, options, progress)
    views, seen, stamps = looks.views, looks.poses, looks.stamps
    if not stamps:
        raise EpisodeError(f"{source.path}: holds no frames that can be read")
    found, why = None, ""
    masks: list[Masks] = []
    if views:
        still = [view for view in views if (view.stamp_ns - views[0].stamp_ns) * 1e-9 <= options.still_s]
        try:
            found = find_object(
                still,
                board_corners=board_outline(board) if seen else None,
                box=options.object_box if any(options.object_box) else None,
                point=options.object_point if any(options.object_point) else None,
            )
        except EpisodeError as error:
            why = str(error)
    if found is not None:
        tracker = MaskTracker(views[0], found.mask)
        for view in views:
            masks.append(tracker.next(view))
            progress("hands", len(masks) / len(views))
    return Watched(
        source=source,
        board=board,
        camera=known,
        camera_is_guessed=camera is None,
        fitting_focal_px=_fitting_focal(small, known, board, looks),
        frames=len(stamps),
        seconds=(stamps[-1] - stamps[0]) * 1e-9,
        looked_s=np.array([(stamp - stamps[0]) * 1e-9 for stamp, _ in looks.looked]),
        posed=np.array([posed for _, posed in looks.looked], bool),
        poses=tuple(seen),
        is_mirrored=not seen and _is_mirrored(views, board),
        why_no_pose=looks.reasons.most_common(1)[0][0] if looks.reasons else "",
        views=tuple(views),
        times=np.array([(view.stamp_ns - stamps[0]) * 1e-9 for view in views]),
        tag_blur_px=np.array(looks.blurs or [np.nan] * len(views)),
        found=found,
        why_no_object=why,
        masks=tuple(masks),
    )


def _shrunk(source: FrameSource) -> FrameSource:
    """The video at the size it is looked at."""
    share = _LARGEST / max(source.width, source.height)
    if share >= 1:
        return source
    size = (round(share * source.width), round(share * source.height))

    def read(wanted: Callable[[int], bool]) -> Iterator[Frame]:
        for frame in source.frames(wanted):
            yield Frame(stamp_ns=frame.stamp_ns, image=cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA))

    return replace(source, width=size[0], height=size[1], read=read)


def guessed_camera(source: FrameSource, board: Board) -> Camera:
    """A pinhole camera whose focal length is from the tags in a few frames, or a phone's if none are seen."""
    size = (source.width, source.height)
    finder, every = TagEdgeFinder(board), max(source.count // 8, 1)
    asked = iter(range(10**9))
    objects, images = [], []
    for frame in source.frames(lambda stamp_ns: next(asked) % every == 0):
        seen = finder.find(frame.image, frame.stamp_ns)
        if len(seen.tags) >= FEWEST_TAGS:
            corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * board.tag_side
            flat = (board.tag_corners[seen.tags][:, None] + corners).reshape(-1, 2)
            objects.append(np.column_stack([flat, np.zeros(len(flat))]).astype(np.float32))
            images.append(seen.corners.reshape(-1, 2).astype(np.float32))
    focal = GUESSED_FOCAL * max(size)
    if len(objects) >= 3:
        fitted = cv2.initCameraMatrix2D(objects, images, size)
        if 0.3 * max(size) < fitted[0, 0] < 4 * max(size):
            focal = float(fitted[0, 0])
    matrix = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    return Camera(width=size[0], height=size[1], matrix=matrix, coefficients=np.zeros(5))


def _is_mirrored(views: list[View], board: Board) -> bool:
    finder = TagEdgeFinder(board)
    some = views[:: max(len(views) // 3, 1)]
    return any(len(finder.find(np.ascontiguousarray(view.image[:, ::-1]), 0).tags) >= FEWEST_TAGS for view in some)


def _fitting_focal(source: FrameSource, camera: Camera, board: Board, looks: "_Looks") -> float:
    if abs(focal_error(looks.poses)[0]) < FOCAL_TOLERANCE:
        return float(camera.matrix[0, 0])
    posed = [view.stamp_ns for view in looks.views]
    chosen = set(posed[:: max(len(posed) // FOCAL_FRAMES, 1)])
    return true_focal([frame.image for frame in source.frames(chosen.__contains__)], camera, board)


@dataclass
class _Looks:
    """Frames looked at."""

    stamps: list[int] = field(default_factory=list)
    looked: list[tuple[int, bool]] = field(default_factory=list)
    """Stamp of each, and whether it has a pose."""
    reasons: Counter[str] = field(default_factory=Counter)
    poses: list[CameraPose] = field(default_factory=list)
    views: list[View] = field(default_factory=list)
    blurs: list[float] = field(default_factory=list)
    """Of the tags in the views with a pose, pixels of the views."""


def _look(
    source: FrameSource,
    camera: Camera,
    board: Board,
    options: PerceptionOptions,
    progress: Callable[[str, float], None],
) -> _Looks:
    looks, full = _Looks(), FullView(camera)
    finder = BoardPoseFinder(board, full.matrix)
    square: SquareView | None = None
    near: CameraPose | None = None
    near_ns = 0

    def look(frame: Frame) -> tuple[Frame, CameraPose | NoPose]:
        is_recent = near is not None and (frame.stamp_ns - near_ns) * 1e-9 < LONGEST_FILLED_GAP_S
        return frame, finder.find(full.image(frame.image), near=near if is_recent else None)

    with ThreadPoolExecutor(_TOGETHER) as pool:
        for some in _batches(source.frames(_sampled(source, options.still_s, looks))):
            for frame, pose in list(pool.map(look, some)):
                looks.looked.append((frame.stamp_ns, isinstance(pose, CameraPose)))
                if isinstance(pose, NoPose):
                    looks.reasons[pose.reason] += 1
                    continue
                looks.poses.append(pose)
                near, near_ns = pose, frame.stamp_ns
                if square is None:
                    turns = upright_turns(full.to_raw_pose(pose.world_from_camera))
                    square = SquareView(camera, turns=turns, side=options.side)
                view = _view(square, frame, square.from_raw_pose(full.to_raw_pose(pose.world_from_camera)))
                if not is_black(view):
                    looks.views.append(view)
                    looks.blurs.append(pose.blur * square.matrix[0, 0] / camera.matrix[0, 0])
            progress("tags", min(len(looks.stamps) / source.count, 1.0))
    if not looks.poses:
        # Without a pose anywhere the views show at least what there is; which way is up is not known.
        again, unposed = _Looks(), SquareView(camera, side=options.side)
        for frame in source.frames(_sampled(source, options.still_s, again)):
            looks.views.append(_view(unposed, frame, np.full((4, 4), np.nan)))
    return looks


def _view(square: SquareView, frame: Frame, world_from_camera: np.ndarray) -> View:
    return View(
        stamp_ns=frame.stamp_ns,
        image=square.image(frame.image),
        camera_matrix=square.matrix,
        world_from_camera=world_from_camera,
    )


def _batches(frames: Iterator[Frame]) -> Iterator[list[Frame]]:
    """A few frames at a time: large ones are not all kept. The first one alone, since others wait for its pose."""
    size = 1
    while some := list(islice(frames, size)):
        yield some
        size = _TOGETHER


def _sampled(source: FrameSource, still_s: float, looks: _Looks) -> Callable[[int], bool]:
    """Which frames are looked at, asked one after the other; keeps all stamps.

    The first ones one by one until a pose is known, then a tenth of a second apart while the object rests, then so
    that there are `VIEWS` in all.
    """
    due = 0

    def wanted(stamp_ns: int) -> bool:
        nonlocal due
        looks.stamps.append(stamp_ns)
        first = looks.stamps[0]
        if not looks.poses and len(looks.stamps) <= _TRIES:
            due = stamp_ns + round(STILL_STEP_S * 1e9) - 1
            return True
        if stamp_ns < due:
            return False
        step = round(STILL_STEP_S * 1e9)
        if (stamp_ns - first) * 1e-9 > still_s:
            usual = (stamp_ns - first) / (len(looks.stamps) - 1)
            step = max(step, round(usual * source.count / VIEWS))
        due = max(due + step, stamp_ns + step // 2)
        return True

    return wanted
