"""Remarks of a first look at a video: what is good, what is doubtful, what is bad, and what to film differently."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.perception.camera.board_pose import FOCAL_TOLERANCE, intrinsics_warning
from egophys_core.perception.check.hands_seen import HandsSeen, hands_seen
from egophys_core.perception.check.image_quality import blur_px, light_of, trackable
from egophys_core.perception.check.stillness import Stillness, depth_error_m, stillness
from egophys_core.perception.check.table_plane import free_table, table_plane
from egophys_core.perception.check.watching import Watched
from egophys_core.perception.masks.table_background import has_pose, table_places
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

_REST_PX = 0.8
"""Pixels: points at rest are seen within this of their places, in the median."""
_SHORTEST_S, _SHORT_S = 1.5, 3.0
"""Seconds: a video holds a second's rest and something that happens."""
_FEWEST_OF_TABLE, _MOST_OF_TABLE = 4, 12
"""Views in which the table is followed."""
_LARGEST_TILT_SIGMA_DEG = 0.5
_TILTED_DEG, _RAISED_M = 2.0, 0.01
"""Degrees and metres that a table may be off."""
_WRONG_FOCAL = 0.03
"""Share; at this the camera is 20 mm from where it is taken to be, at 0.7 m."""
_DARK, _CLIPPED = 12, 250
"""Grey levels below and above which an object shows nothing."""


@dataclass(frozen=True, kw_only=True)
class Checked:
    """What a first look at a video found."""

    remarks: tuple[Remark, ...]
    blur_px: np.ndarray
    """[V] pixels of the square views."""
    light: np.ndarray
    """[V] brightness relative to the first view."""
    hands: HandsSeen | None
    """None without an object."""
    trackable: np.ndarray | None
    """[S, S] bool: pixels of the object in the first view that can be followed."""
    still: Stillness | None
    """None without an object or without poses."""


def check(watched: Watched, still_s: float, warned: Sequence[str] = ()) -> Checked:
    """Judge what was seen of a video.

    Args:
        watched: what was seen.
        still_s: seconds in which the object should rest at first.
        warned: sentences about the recording itself: cut, frames missing.
    """
    remarks = [_length(watched), *(_recording(each) for each in warned), _tags(watched), *_camera(watched)]
    views, found = watched.views, watched.found
    # Speckles look sharper than they are; the tags' edges are known.
    blur = np.fmax(np.array([blur_px(view.image) for view in views]), watched.tag_blur_px)
    light = light_of(views, [each.object | each.hand for each in watched.masks]) if views else np.zeros(0)
    if views:
        remarks += [_blur(watched, blur), *_exposure(watched, light)]
    if found is None:
        advice = "put one object with a pattern alone on a plain, lit table, and start the video where it is in view"
        remarks.append(Remark(name="object", level=Level.BAD, text=watched.why_no_object or "no views", advice=advice))
        return Checked(remarks=tuple(remarks), blur_px=blur, light=light, hands=None, trackable=None, still=None)
    followed = trackable(views[0].image) & found.mask
    hands = hands_seen(watched.times, watched.masks)
    at_first = tuple(view for view in views if (view.stamp_ns - views[0].stamp_ns) * 1e-9 <= still_s)
    still = stillness(at_first, found.mask) if has_pose(views[0]) and len(at_first) > 2 else None
    remarks += [
        _object(watched),
        _texture(followed, found.mask),
        _rest(still, still_s),
        *_parallax(watched, at_first),
        *_table(watched),
        *_hands(hands, watched, still_s),
    ]
    return Checked(remarks=tuple(remarks), blur_px=blur, light=light, hands=hands, trackable=followed, still=still)


def _length(watched: Watched) -> Remark:
    rate = (watched.frames - 1) / watched.seconds if watched.seconds > 0 else 0.0
    size = f"{watched.source.width} x {watched.source.height}"
    text = f"{watched.frames} frames, {watched.seconds:.1f} s, {rate:.0f} a second, {size}"
    if watched.seconds < _SHORT_S:
        level = Level.BAD if watched.seconds < _SHORTEST_S else Level.DOUBTFUL
        return Remark(name="length", level=level, text=text, advice="film 4 to 10 s, the first second without touching")
    return graded("length", rate, ok=14, bad=7, text=text, advice="film at 30 frames a second")


def _recording(warned: str) -> Remark:
    advice = "copy the recording again, or record with less load on the disk and the network"
    return Remark(name="recording", level=Level.DOUBTFUL, text=warned, advice=advice)


def _tags(watched: Watched) -> Remark:
    looked_at = len(watched.posed)
    share = len(watched.poses) / max(looked_at, 1)
    text = f"the board gives the camera's place in {len(watched.poses)} of {looked_at} frames looked at"
    if watched.poses and watched.why_no_pose:
        text += f"; elsewhere {watched.why_no_pose}"
    elif not watched.poses:
        text += f": {watched.why_no_pose}; nothing has a scale, and rest and depth cannot be told"
    if watched.is_mirrored:
        text = "the board is seen mirrored: in a mirror, or by a camera that mirrors what it films"
        advice = "film with the back camera, and switch off mirroring"
        return Remark(name="tags", level=Level.BAD, text=text, advice=advice)
    return graded("tags", share, ok=0.9, bad=0.2, text=text, advice=KEEP_THE_BOARD)


def _camera(watched: Watched) -> list[Remark]:
    if watched.camera_is_guessed:
        by = "guessed from the tags" if watched.poses else "guessed"
        focal = watched.camera.matrix[0, 0] * watched.source.width / watched.camera.width
        text = f"no intrinsics are given; a focal length of {focal:.0f} pixels was {by}"
        return [Remark(name="camera", level=Level.DOUBTFUL, text=text, advice=RECALIBRATE)]
    if not watched.poses:
        return []
    warning = intrinsics_warning(watched.poses)
    if warning is None:
        return [Remark(name="camera", level=Level.OK, text="the tags agree with the intrinsics")]
    given, fitting = watched.camera.matrix[0, 0], watched.fitting_focal_px
    off = given / fitting - 1
    if abs(off) < FOCAL_TOLERANCE:
        return [Remark(name="camera", level=Level.DOUBTFUL, text=warning, advice=RECALIBRATE)]
    share = watched.source.width / watched.camera.width
    wrong = f"{100 * abs(off):.1f} % too {'long' if off > 0 else 'short'}"
    text = (
        f"the focal length of {share * given:.0f} pixels is {wrong}, the tags fit {share * fitting:.0f}; distances "
        "along the view are wrong by as much"
    )
    level = Level.BAD if abs(off) > _WRONG_FOCAL else Level.DOUBTFUL
    return [Remark(name="camera", level=level, text=text, advice=RECALIBRATE)]


def _blur(watched: Watched, blur: np.ndarray) -> Remark:
    usual, worst = float(np.median(blur)), float(np.percentile(blur, 90))
    side = watched.views[0].image.shape[0]
    text = f"edges are {usual:.1f} pixels soft, a tenth of the views more than {worst:.1f} (views of {side})"
    advice = "move the head slowly, add light (a shorter exposure), wipe the lens, fix the focus on the table"
    return graded("sharpness", max(usual, worst / 1.5), ok=1.3, bad=2.4, text=text, advice=advice)


def _exposure(watched: Watched, light: np.ndarray) -> list[Remark]:
    gray = np.stack([view.image[::4, ::4].mean(axis=2) for view in watched.views[:: max(len(watched.views) // 8, 1)]])
    level = float(np.median(gray))
    clipped, dark = float((gray >= _CLIPPED).mean()), float((gray <= _DARK).mean())
    low, high = float(np.nanmin(light)), float(np.nanmax(light))
    step = float(np.nanmax(np.abs(np.diff(np.log(light))), initial=0.0))
    remarks = []
    if dark > 0.5 or level < 45:
        remarks.append(
            graded(
                "exposure", level, ok=45, bad=25, text=f"dark: the median is {level:.0f} of 255", advice="more light"
            )
        )
    elif clipped > 0.1:
        text = f"{100 * clipped:.0f} % of the image is white without detail"
        advice = "less light, no direct sun, or lock the exposure on the table"
        remarks.append(graded("exposure", clipped, ok=0.1, bad=0.35, text=text, advice=advice))
    else:
        remarks.append(Remark(name="exposure", level=Level.OK, text=f"the median is {level:.0f} of 255"))
    text = f"the table's brightness goes from {low:.2f} to {high:.2f} of that in the first view"
    advice = "lock exposure and white balance (on a phone: hold the finger on the table until it says so)"
    changing = max(abs(np.log(max(low, 1e-3))), abs(np.log(max(high, 1e-3))), 2 * step)
    remarks.append(graded("light", changing, ok=0.35, bad=0.9, text=text, advice=advice))
    return remarks


def _object(watched: Watched) -> Remark:
    found, side = watched.found, watched.views[0].image.shape[0]
    assert found is not None
    share = float(found.mask.mean())
    x0, y0, x1, y1 = found.box
    size = f"{x1 - x0} x {y1 - y0} pixels, {100 * share:.1f} % of the view"
    text = f"taken for the object: what is at {(x0 + x1) // 2} {(y0 + y1) // 2}, {size}"
    cut = min(x0, y0) <= 1 or max(x1, y1) >= side - 1
    if found.others:
        text += "; less like it: " + ", ".join(
            f"at {(one.box[0] + one.box[2]) // 2} {(one.box[1] + one.box[3]) // 2} (score {one.score:.3f})"
            for one in found.others[:3]
        )
    if found.warning:
        return Remark(
            name="object",
            level=Level.DOUBTFUL,
            text=f"{text}; {len(found.others) + 1} things could be it",
            advice=NAME_IT,
        )
    if cut:
        return Remark(
            name="object",
            level=Level.BAD,
            text=f"{text}, cut by the border",
            advice="keep all of it in the middle of the view",
        )
    return graded("object", share, ok=0.02, bad=0.005, text=text, advice="go nearer: half a metre to a metre away")


def _texture(followed: np.ndarray, mask: np.ndarray) -> Remark:
    share = np.count_nonzero(followed) / max(np.count_nonzero(mask), 1)
    text = f"{100 * share:.0f} % of the object has a pattern that can be followed"
    return graded("texture", share, ok=0.6, bad=0.25, text=text, advice=MARK_IT)


def _rest(still: Stillness | None, still_s: float) -> Remark:
    advice = rest_first(still_s)
    if still is None or not np.isfinite(still.residual_px[1:]).any():
        why = "too few views with a pose of the camera" if still is None else "too few of its points are followed"
        text = f"cannot be told: {why} in the first second"
        return Remark(name="rest", level=Level.DOUBTFUL, text=text, advice=advice)
    begin, lasts = still.rests(_REST_PX)
    usual = float(np.nanmedian(still.residual_px))
    if lasts == 0.0:
        text = f"it never rests in the first second: its points are {usual:.1f} pixels from any place at rest"
    else:
        since = f"from {begin:.1f} s on" if begin > 0 else "from the start"
        text = f"it rests {since}, for {lasts:.1f} s of the first {still.times[-1]:.1f}"
    return graded("rest", lasts / still.times[-1], ok=0.6, bad=0.35, text=text, advice=advice)


def _parallax(watched: Watched, at_first: tuple) -> list[Remark]:
    assert watched.found is not None
    x0, y0, x1, y1 = watched.found.box
    if not has_pose(watched.views[0]) or len(at_first) < 3:
        return []
    centre = table_places(watched.views[0], np.array([[(x0 + x1) / 2, (y0 + y1) / 2]]))[0]
    if not np.isfinite(centre).all():
        return []
    aside, error = depth_error_m(at_first, np.array([*centre, 0.0]))
    text = (
        f"the head moves by {1000 * aside:.0f} mm in the first second: depth to about {min(1000 * error, 999):.0f} mm"
    )
    advice = "sway the head (or the phone) by 5 to 10 cm while the object rests: depth comes from that"
    return [graded("parallax", error, ok=0.005, bad=0.02, text=text, advice=advice)]


def _table(watched: Watched) -> list[Remark]:
    """Whether the board lies on the table; nothing where that cannot be told."""
    assert watched.found is not None
    hands = [index for index, each in enumerate(watched.masks) if each.hand.any()]
    views = watched.views[: min([*hands, len(watched.views)])]
    if len(views) < _FEWEST_OF_TABLE or not has_pose(views[0]):
        return []
    plane = table_plane(views[:_MOST_OF_TABLE], free_table(views[0], watched.found.mask, watched.board))
    if plane is None or plane.tilt_sigma_deg > _LARGEST_TILT_SIGMA_DEG:
        return []
    text = (
        f"the table is tilted by {plane.tilt_deg:.1f} degrees against the board, and lies "
        f"{1000 * abs(plane.height_m):.0f} mm {'over' if plane.height_m > 0 else 'under'} where the board has it"
    )
    advice = "lay the board flat on the table itself, not on a book or over an edge"
    off = max(plane.tilt_deg / _TILTED_DEG, abs(plane.height_m) / _RAISED_M)
    return [graded("table", off, ok=1.0, bad=2.5, text=text, advice=advice)]


def _hands(hands: HandsSeen, watched: Watched, still_s: float) -> list[Remark]:
    if hands.count == 0:
        return [Remark(name="hands", level=Level.BAD, text="none comes in", advice=HANDLE_IT)]
    name = "one hand" if hands.count == 1 else "two hands"
    text = f"{name}, from {hands.first_s:.1f} s on"
    advice = f"keep the hands out of view for the first {max(still_s, 1):g} s"
    since = hands.first_s - watched.times[0]
    return [graded("hands", since / still_s, ok=0.4, bad=0.15, text=text, advice=advice)]
