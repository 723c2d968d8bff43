"""Whether what was seen of a video will do for a twin: why, and what to film differently."""

from collections.abc import Sequence

import numpy as np

from egophys_core.perception.remarks import (
    HANDLE_IT,
    KEEP_THE_BOARD,
    MARK_IT,
    NAME_IT,
    RECALIBRATE,
    Level,
    Remark,
    graded,
    rest_first,
)
from egophys_core.perception.seconds import Second

FEW_POSES, TOO_FEW_POSES = 0.9, 0.5
"""Shares of the frames whose camera pose is known."""
STILL_PX, MOVING_PX = 0.5, 0.8
"""Pixels, median: how far points at rest are from one place over the first views."""
FEW_POINTS, TOO_FEW_POINTS = 0.3, 0.12
"""Coverages of a second. A sheet that is folded twice hides three quarters of itself, through no fault of the video."""
TOO_MANY_SECONDS = 0.5
"""Share of the seconds with too few points from which on a video is poor; one with few makes it doubtful."""
DOUBTFUL, MOSTLY_DOUBTFUL = 0.25, 0.5
"""Shares of the followed points that are too doubtful for the episode."""


def judge(
    *,
    seconds: Sequence[Second],
    frames: int,
    posed: int,
    hand_seen: int,
    has_contact: bool,
    still_s: float,
    scale_is_known: bool = True,
    rest_px: float | None = None,
    lens: str = "",
    choice: str = "",
) -> tuple[Remark, ...]:
    """Remarks on a perceived video, of which the worst is the verdict (`verdict_of`).

    Args:
        seconds: what was seen in each.
        frames: of the video.
        posed: of them, those with a camera pose, found or interpolated.
        hand_seen: of them, those with a hand.
        has_contact: whether a hand holds or presses the object at some time.
        still_s: time at the start in which it should rest.
        scale_is_known: whether lengths are metres.
        rest_px: pixels, median residual of points taken to rest; infinite if none could be followed, None if that is
            not known.
        lens: what speaks against the intrinsics, a sentence; empty if nothing does.
        choice: what speaks against the choice of the object, likewise.
    """
    remarks = [_camera(frames, posed)]
    if not scale_is_known:
        text = "no tag board is seen: lengths are in units of an assumed height of the camera"
        remarks.append(Remark(name="scale", level=Level.DOUBTFUL, text=text, advice=KEEP_THE_BOARD))
    if lens:
        remarks.append(Remark(name="lens", level=Level.DOUBTFUL, text=lens, advice=RECALIBRATE))
    if choice:
        remarks.append(Remark(name="object", level=Level.DOUBTFUL, text=choice, advice=NAME_IT))
    if rest_px is not None:
        remarks.append(_rest(rest_px, still_s))
    return (*remarks, _hands(seconds, hand_seen, has_contact), _coverage(seconds), _doubt(seconds))


def _camera(frames: int, posed: int) -> Remark:
    text = f"the camera's pose is known in {posed} of {frames} frames"
    return graded("camera", posed / frames, ok=FEW_POSES, bad=TOO_FEW_POSES, text=text, advice=KEEP_THE_BOARD)


def _rest(rest_px: float, still_s: float) -> Remark:
    if not np.isfinite(rest_px):
        text = "the object has no pattern that can be followed while it rests: its depth is a guess"
        return Remark(name="rest", level=Level.BAD, text=text, advice=MARK_IT)
    where = f"its points are {rest_px:.1f} pixels from one place in the median"
    text = f"the object {'never rests' if rest_px >= MOVING_PX else 'rests'} in the first {still_s:g} s: {where}"
    return graded("rest", rest_px, ok=STILL_PX, bad=MOVING_PX, text=text, advice=rest_first(still_s))


def _hands(seconds: Sequence[Second], hand_seen: int, has_contact: bool) -> Remark:
    if hand_seen == 0:
        return Remark(name="hands", level=Level.BAD, text="no hand is seen", advice=HANDLE_IT)
    if not has_contact:
        text = f"a hand is seen in {hand_seen} frames, and the object never moves with it"
        return Remark(name="hands", level=Level.BAD, text=text, advice=HANDLE_IT)
    touching = [second for second in seconds if second.touching]
    most = max((second.touching for second in touching), default=1)
    since = f", from second {touching[0].start_s:.0f} on" if touching else ""
    text = f"{'one hand acts' if most == 1 else f'{most} hands act'} on the object{since}"
    return Remark(name="hands", level=Level.OK, text=text)


def _coverage(seconds: Sequence[Second]) -> Remark:
    coverage = np.array([second.coverage for second in seconds])
    least, too_few = int(coverage.argmin()), int((coverage < TOO_FEW_POINTS).sum())
    text = (
        f"{100 * coverage.mean():.0f} % of the points are found, {100 * coverage[least]:.0f} % in second {least}; "
        f"less than {100 * TOO_FEW_POINTS:.0f} % in {too_few} of {len(seconds)} seconds"
    )
    if coverage[least] >= FEW_POINTS:
        return Remark(name="coverage", level=Level.OK, text=text)
    level = Level.BAD if too_few >= TOO_MANY_SECONDS * len(seconds) else Level.DOUBTFUL
    advice = "move the object slowly, with arms and folds not in front of it, wholly in view, and in bright light"
    return Remark(name="coverage", level=level, text=text, advice=advice)


def _doubt(seconds: Sequence[Second]) -> Remark:
    doubtful, sure = (float(np.mean(each)) for each in zip(*((s.doubtful, s.coverage) for s in seconds), strict=True))
    share = doubtful / (doubtful + sure) if doubtful + sure > 0 else float("nan")
    text = f"{100 * share:.0f} % of the points that are followed are too doubtful to use"
    advice = "film nearer and slower, in more light, and an object with a pattern"
    return graded("doubt", share, ok=DOUBTFUL, bad=MOSTLY_DOUBTFUL, text=text, advice=advice)
