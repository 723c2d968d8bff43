"""Where the camera of a video is in each of its frames."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.background_motion import background_poses
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import (
    FEWEST_TAGS,
    BoardPoseFinder,
    CameraPose,
    NoPose,
    doubts_focal,
    intrinsics_warning,
)
from egophys_core.perception.camera.exposure import flicker_note, row_brightness
from egophys_core.perception.camera.focal_length import focal_length
from egophys_core.perception.camera.lens import FullView, upright_turns
from egophys_core.perception.camera.pose_track import LONGEST_FILLED_GAP_S, PoseTrack, track_poses
from egophys_core.perception.camera.table_poses import poses_over_table
from egophys_core.perception.camera.video import Video

COMPARED_FRAMES = 12
"""Frames in which the board is seen, spread over the video, that are compared with the table, or tell the lens."""


@dataclass(frozen=True, kw_only=True)
class CameraPath:
    """Poses of the raw camera over the frames that can be decoded."""

    stamps_ns: list[int]
    """[T] header stamps, nanoseconds since the epoch."""
    track: PoseTrack
    """T poses."""
    turns: int
    """Counter-clockwise quarter turns (0..3) of the image after which it is upright."""
    board: Board | None
    """Where it lies; None if it is seen in no frame: lengths are then in units of an assumed height of the camera."""
    notes: tuple[str, ...]
    """Sentences for the user: what was inferred, missing or doubtful, with numbers."""
    lens: str = ""
    """That of them which speaks against the intrinsics; empty if none does."""

    @property
    def scale_is_known(self) -> bool:
        """Whether lengths are metres."""
        return self.board is not None


def find_camera_path(video: Video, board: Board, *, height_m: float, tell: Callable[[str, float], None]) -> CameraPath:
    """Poses from the tag board and, where it is not seen, from the table that it lies on.

    The world is the board's; if the board is seen in no frame, it is the table's, and the scale is assumed.

    Args:
        video: to go through.
        board: the printed board on the table.
        height_m: what the first camera's height over the table is taken for where no board is seen, metres.
        tell: called with a stage and the share of it that is done, 0..1.

    Raises:
        EpisodeError: no board is seen, and the table does not tell the camera's motion; or the board is seen as in a
            mirror; says what to do.
    """
    full = FullView(video.camera)
    sight = _look_for_board(video, full, board, tell)
    if sight.located:
        return _path_from_board(video, full, board, sight)
    _require_unmirrored(video, full, board)
    return _path_from_table(video, full, sight, height_m)


@dataclass(frozen=True, kw_only=True)
class _Sight:
    """What one look at each of T frames says."""

    stamps_ns: list[int]
    located: dict[int, CameraPose]
    """Poses from the board, by frame."""
    reasons: Counter[str]
    """Why the others have none."""
    flicker: str | None
    """Note on the light."""


def _look_for_board(video: Video, full: FullView, board: Board, tell: Callable[[str, float], None]) -> _Sight:
    finder = BoardPoseFinder(board, full.matrix)
    stamps_ns: list[int] = []
    located: dict[int, CameraPose] = {}
    reasons: Counter[str] = Counter()
    brightness: list[np.ndarray] = []
    near: CameraPose | None = None
    near_ns = 0
    for index, frame in enumerate(video.frames()):
        is_recent = near is not None and (frame.stamp_ns - near_ns) * 1e-9 < LONGEST_FILLED_GAP_S
        pose = finder.find(full.image(frame.image), near=near if is_recent else None)
        if isinstance(pose, NoPose):
            reasons[pose.reason] += 1
        else:
            near, near_ns = pose, frame.stamp_ns
            located[index] = pose
        stamps_ns.append(frame.stamp_ns)
        brightness.append(row_brightness(frame.image))
        tell("camera poses", min((index + 1) / max(len(video), 1), 1.0))
    return _Sight(stamps_ns=stamps_ns, located=located, reasons=reasons, flicker=flicker_note(brightness))


def _path_from_board(video: Video, full: FullView, board: Board, sight: _Sight) -> CameraPath:
    """Metric poses: from the board where it is seen, from the table's texture elsewhere."""
    count, located = len(sight.stamps_ns), sight.located
    table = poses_over_table(_images(video, full, _frames_to_tie(count, located)), located, board, full.matrix)
    matrices = np.full((count, 4, 4), np.nan)
    for index, pose in located.items():
        matrices[index] = pose.world_from_camera if table is None else table.world_from_said @ pose.world_from_camera
    for index, matrix in ({} if table is None else table.world_from_camera).items():
        # Where the board is seen as well, both have a say in these, so that nothing jumps where it disappears.
        matrices[index] = matrix
    carried = int(np.isfinite(matrices).all(axis=(1, 2)).sum()) - len(located)
    track = track_poses(sight.stamps_ns, matrices)
    lens = _note_of_intrinsics(video, full, board, located)
    notes = (
        lens,
        _note_of_gaps(track, len(located), carried, sight.reasons),
        None if table is None else table.note,
        sight.flicker,
    )
    first = track.world_from_camera[int(np.argmax(track.known))]
    return CameraPath(
        stamps_ns=sight.stamps_ns,
        track=track,
        turns=upright_turns(full.to_raw_pose(first)),
        board=board if table is None else table.board,
        notes=tuple(note for note in notes if note),
        lens=lens or "",
    )


def _images(video: Video, full: FullView, chosen: set[int]) -> Iterator[tuple[int, np.ndarray]]:
    """Pinhole images of some frames, with their numbers."""
    return ((index, full.image(frame.image)) for index, frame in enumerate(video.frames()) if index in chosen)


def _frames_to_tie(count: int, located: dict[int, CameraPose]) -> set[int]:
    """Frames without a pose from the board, those beside them, and a few others to compare board and table by."""
    missing = set(range(count)) - set(located)
    beside = {index + step for index in missing for step in (-1, 1)} & set(located)
    return missing | beside | _spread_out(located)


def _spread_out(located: dict[int, CameraPose]) -> set[int]:
    """A few of the frames in which the board is seen."""
    shares = np.linspace(0, len(located) - 1, COMPARED_FRAMES).round().astype(int)
    return set(np.array(sorted(located))[shares].tolist())


def _note_of_intrinsics(video: Video, full: FullView, board: Board, located: dict[int, CameraPose]) -> str | None:
    """What the board says against the intrinsics, and by how much they are wrong."""
    poses = list(located.values())
    if doubts_focal(poses):
        images = [image for _, image in _images(video, full, _spread_out(located))]
        found = focal_length(images, board, full.matrix)
        if found is not None:
            return found.note
    return intrinsics_warning(poses)


def _note_of_gaps(track: PoseTrack, located: int, carried: int, reasons: Counter[str]) -> str | None:
    """How many poses come from where, if not all from the board."""
    if not reasons:
        return None
    inferred, lost = int(track.inferred.sum()), int((~track.known).sum())
    left_out = ", whose frames are left out" if lost else ""
    without = "" if carried else " (too little of it is seen)"
    return (
        f"camera poses of {len(track.known)} frames: {located} from the board, {carried} from the table's "
        f"texture{without}, in the board's frame and scale, {inferred} interpolated over gaps of at most "
        f"{LONGEST_FILLED_GAP_S} s, {lost} missing{left_out} (the board: most often {reasons.most_common(1)[0][0]})"
    )


def _path_from_table(video: Video, full: FullView, sight: _Sight, height_m: float) -> CameraPath:
    """Poses up to scale from the texture of the table."""
    usual = sight.reasons.most_common(1)[0][0] if sight.reasons else "there are no frames"
    frames = ((frame.stamp_ns, full.image(frame.image)) for frame in video.frames())
    try:
        background = background_poses(frames, full.matrix, height_m=height_m)
    except EpisodeError as error:
        raise EpisodeError(
            f"{video.path.name}: no tag board is seen in any of {len(sight.stamps_ns)} frames ({usual}), and the "
            f"camera's motion does not follow from the table either: {error}. Put a tag board on the table "
            "(`egophys board` prints one) and keep it in view, or give its layout if it is another one"
        ) from error
    known = background.known
    first = background.world_from_camera[int(np.argmax(known))]
    return CameraPath(
        stamps_ns=sight.stamps_ns,
        track=PoseTrack(
            world_from_camera=background.world_from_camera, inferred=np.zeros(len(known), bool), known=known
        ),
        turns=upright_turns(full.to_raw_pose(first)),
        board=None,
        notes=(f"no tag board is seen ({usual}): {background.note}", *([sight.flicker] if sight.flicker else [])),
    )


def _require_unmirrored(video: Video, full: FullView, board: Board) -> None:
    """Check that the board is not seen as in a mirror.

    Raises:
        EpisodeError: it is; says what to do.
    """
    finder = BoardPoseFinder(board, full.matrix)
    chosen = set(range(0, len(video), max(1, len(video) // COMPARED_FRAMES)))
    for index, image in _images(video, full, chosen):
        if (tags := finder.mirrored_tags(image)) >= FEWEST_TAGS:
            raise EpisodeError(
                f"{video.path.name}: {tags} tags of the board are seen as in a mirror (frame {index}): either the "
                "camera mirrors its images, as front cameras of phones do, and the whole scene would be "
                "reconstructed mirrored: switch that off and film again, or flip the images; or the board was "
                "printed mirrored: print it again (`egophys board`)"
            )
