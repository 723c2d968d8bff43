"""The one picture of a check: the first view with what is taken for the object, the remarks, views and curves."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from egophys_core.perception.check.check_video import Checked
from egophys_core.perception.check.watching import Watched
from egophys_core.perception.overlay import HAND_COLOUR, OBJECT_COLOUR
from egophys_core.perception.remarks import Level, Remark, verdict_of, worst
from egophys_core.perception.stages import Masks

WIDTH, MARGIN = 1640, 22
PAPER, INK, FAINT, RULE = (250, 250, 248), (32, 36, 42), (112, 118, 126), (214, 214, 210)
LEVELS = {Level.OK: (46, 139, 87), Level.DOUBTFUL: (214, 140, 16), Level.BAD: (200, 48, 44)}
"""RGB, as all colours of this file but those of overlays."""
SMALL_VIEWS = 6

_OBJECT, _HAND = OBJECT_COLOUR[::-1], HAND_COLOUR[::-1]
_RIVAL = (255, 205, 60)
_CURVE_HEIGHT = 44
_LABEL_WIDTH = 150

Place = tuple[int, int]
Colour = tuple[int, int, int]


def check_picture(watched: Watched, checked: Checked, *, point: tuple[float, float] | None = None) -> np.ndarray:
    """[H, 1640, 3] uint8 BGR.

    The first view lies in the upper left corner at its own size: the pixels of the picture are its pixels there, and
    so what `--object "x y"` takes.

    Args:
        watched: what was seen.
        checked: what was found.
        point: x, y that the user gave for the object.
    """
    first = _first_view(watched, checked, point)
    side = first.width
    text_x = side + MARGIN
    rows = _wrapped(checked.remarks, WIDTH - text_x - MARGIN - 170)
    text_height = 150 + sum(row[3] for row in rows)
    top = max(side, text_height) + MARGIN
    thumbnails = _thumbnails(watched, checked)
    strip_height = thumbnails[0][0].height + 34 if thumbnails else 0
    curves = _curves(watched, checked)
    picture = Image.new("RGB", (WIDTH, top + strip_height + (len(curves) + 1) * _CURVE_HEIGHT + 40), PAPER)
    picture.paste(first, (0, 0))
    draw = ImageDraw.Draw(picture)
    _write_remarks(draw, watched, rows, text_x)
    _write_key(draw, (text_x, top - MARGIN - 44))
    x = MARGIN
    for image, title in thumbnails:
        picture.paste(image, (x, top))
        draw.text((x, top + image.height + 5), title, fill=FAINT, font=_font(14))
        x += image.width + 12
    y = _draw_posed(draw, watched, top + strip_height + 8)
    _draw_curves(draw, curves, watched, y)
    return np.asarray(picture)[..., ::-1].copy()


def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts/ttf" / name), size)


def _title(path: Path) -> str:
    """The end of a path: recordings in different folders often have the same name."""
    return "/".join(path.resolve().parts[-2:])


def _first_view(watched: Watched, checked: Checked, point: tuple[float, float] | None) -> Image.Image:
    """The view the object is chosen in, with its outline, other things it could be, and a ruler in pixels."""
    if not watched.views:
        return Image.new("RGB", (518, 518), (60, 62, 66))
    view = watched.views[0].image.copy()
    found = watched.found
    if found is not None:
        _outline(view, found.mask, OBJECT_COLOUR, 2)
        for rival in found.others:
            _outline(view, rival.mask, _RIVAL[::-1], 1)
    picture = Image.fromarray(view[..., ::-1])
    draw = ImageDraw.Draw(picture)
    _ruler(draw, picture.width)
    if found is not None:
        for rank, rival in enumerate(found.others[:4], start=2):
            x, y = _middle(rival.box)
            _tag(draw, (x, y), f"{rank}: at {x} {y}", _RIVAL)
        x, y = _middle(found.box)
        _cross(draw, (x, y), _OBJECT)
        _tag(draw, (x, found.box[3] + 12), f"object, at {x} {y}", _OBJECT)
    if point is not None:
        _cross(draw, (round(point[0]), round(point[1])), (255, 60, 255))
    return picture


def _ruler(draw: ImageDraw.ImageDraw, side: int) -> None:
    font = _font(11)
    for at in range(50, side, 50):
        length = 9 if at % 100 == 0 else 5
        for begin, end in (((at, 0), (at, length)), ((0, at), (length, at))):
            draw.line([begin, end], fill=(0, 0, 0), width=3)
            draw.line([begin, end], fill=(255, 255, 255), width=1)
        if at % 100 == 0:
            for place, anchor in (((at, 11), "mt"), ((12, at), "lm")):
                draw.text(place, str(at), fill="white", font=font, anchor=anchor, stroke_width=2, stroke_fill="black")


def _cross(draw: ImageDraw.ImageDraw, place: Place, colour: Colour) -> None:
    x, y = place
    for width, fill in ((4, (0, 0, 0)), (2, colour)):
        draw.line([(x - 7, y), (x + 7, y)], fill=fill, width=width)
        draw.line([(x, y - 7), (x, y + 7)], fill=fill, width=width)


def _tag(draw: ImageDraw.ImageDraw, place: Place, text: str, colour: Colour) -> None:
    font = _font(13, bold=True)
    half = draw.textlength(text, font=font) / 2
    x = min(max(place[0], half + 4), 518 - half - 4)
    draw.text((x, place[1]), text, fill=colour, font=font, anchor="mm", stroke_width=2, stroke_fill=(0, 0, 0))


def _middle(box: tuple[int, int, int, int]) -> Place:
    return (box[0] + box[2]) // 2, (box[1] + box[3]) // 2


def _outline(image: np.ndarray, mask: np.ndarray, colour: Colour, width: int) -> None:
    """Draw the rim of a mask into an image, BGR, on a dark one so that it shows on anything."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, contours, -1, (20, 20, 20), width + 2, cv2.LINE_AA)
    cv2.drawContours(image, contours, -1, colour, width, cv2.LINE_AA)


Row = tuple[Remark, list[str], list[str], int]


def _wrapped(remarks: Sequence[Remark], width: int) -> list[Row]:
    """Remarks with the lines of their text and advice, and the height of each, pixels."""
    letters = width // 8
    rows = []
    for each in remarks:
        text = textwrap.wrap(each.text, letters) or [""]
        advice = textwrap.wrap(each.advice, letters - 3)
        rows.append((each, text, advice, 20 * (len(text) + len(advice)) + 11))
    return rows


def _write_remarks(draw: ImageDraw.ImageDraw, watched: Watched, rows: list[Row], x: int) -> None:
    remarks, y = [row[0] for row in rows], 18
    verdict, level = verdict_of(remarks), worst(remarks)
    badge = _font(24, bold=True)
    width = draw.textlength(verdict, font=badge) + 36
    draw.rounded_rectangle([x, y, x + width, y + 44], 10, fill=LEVELS[level])
    draw.text((x + width / 2, y + 22), verdict, fill="white", font=badge, anchor="mm")
    draw.text((x + width + 16, y + 22), _title(watched.source.path), fill=INK, font=_font(22, bold=True), anchor="lm")
    y += 64
    for remark, text, advice, height in rows:
        draw.line([(x, y - 3), (WIDTH - MARGIN, y - 3)], fill=RULE)
        draw.text((x + 8, y + 11), "\N{BLACK CIRCLE}", fill=LEVELS[remark.level], font=_font(22), anchor="mm")
        draw.text((x + 24, y + 3), remark.name, fill=INK, font=_font(15, bold=True))
        at = y + 3
        for line in text:
            draw.text((x + 170, at), line, fill=INK, font=_font(15))
            at += 20
        for index, line in enumerate(advice):
            start = "\N{RIGHTWARDS ARROW} " if index == 0 else "    "
            draw.text((x + 170, at), start + line, fill=LEVELS[remark.level], font=_font(15))
            at += 20
        y += height


def _write_key(draw: ImageDraw.ImageDraw, place: Place) -> None:
    x, y = place
    for colour, text in ((_OBJECT, "object"), (_HAND, "hand"), (_RIVAL, "could be the object, too")):
        draw.rectangle([x, y, x + 14, y + 12], fill=colour)
        draw.text((x + 21, y + 6), text, fill=FAINT, font=_font(14), anchor="lm")
        x += 44 + int(draw.textlength(text, font=_font(14)))
    text = 'for another object give --object "x y": pixels of the view at the left, as on its rulers'
    draw.text((place[0], y + 30), text, fill=FAINT, font=_font(14), anchor="lm")


def _thumbnails(watched: Watched, checked: Checked) -> list[tuple[Image.Image, str]]:
    """The object's pattern, and views over the video with object and hands, with titles."""
    if not watched.views:
        return []
    side = (WIDTH - 2 * MARGIN - 12 * SMALL_VIEWS) // (SMALL_VIEWS + 1)
    made = []
    if checked.trackable is not None and watched.found is not None:
        made.append((_pattern(watched, checked.trackable, side), "green: can be followed"))
    count = min(SMALL_VIEWS + (not made), len(watched.views))
    for index in np.linspace(0, len(watched.views) - 1, count).round().astype(int):
        image = watched.views[index].image.copy()
        if watched.masks:
            _draw_masks(image, watched.masks[index])
        small = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA)
        made.append((Image.fromarray(small[..., ::-1]), f"{watched.times[index]:.1f} s"))
    return made


def _draw_masks(image: np.ndarray, masks: Masks) -> None:
    for mask, colour in ((masks.object, OBJECT_COLOUR), (masks.hand, HAND_COLOUR)):
        image[mask] = (0.75 * image[mask] + 0.25 * np.array(colour)).astype(np.uint8)
        _outline(image, mask, colour, 2)


def _pattern(watched: Watched, trackable: np.ndarray, side: int) -> Image.Image:
    """The object, magnified: green where it can be followed, red where not."""
    assert watched.found is not None
    image, mask = watched.views[0].image.copy(), watched.found.mask
    x0, y0, x1, y1 = watched.found.box
    half = min(max(x1 - x0, y1 - y0) // 2 + 8, image.shape[0] // 2)
    x, y = (int(np.clip(each, half, image.shape[0] - half)) for each in _middle(watched.found.box))
    for part, colour in ((mask & trackable, (60, 180, 60)), (mask & ~trackable, (50, 50, 230))):
        image[part] = (0.65 * image[part] + 0.35 * np.array(colour)).astype(np.uint8)
    crop = image[y - half : y + half, x - half : x + half]
    return Image.fromarray(cv2.resize(crop, (side, side), interpolation=cv2.INTER_CUBIC)[..., ::-1])


Curve = tuple[str, np.ndarray, float, float, Colour]


def _curves(watched: Watched, checked: Checked) -> list[Curve]:
    """Name, values [V], lowest and highest drawn, and colour of what changes over the video."""
    if not watched.views:
        return []
    curves: list[Curve] = [
        ("softness, pixels", checked.blur_px, 0.0, max(2.4, float(np.nanmax(checked.blur_px))), (70, 110, 180)),
        ("light of the table", checked.light, 0.0, max(1.5, float(np.nanmax(checked.light))), (190, 150, 40)),
    ]
    if checked.hands is not None:
        areas = 100 * checked.hands.areas
        curves.append(("hands, % of view", areas, 0.0, max(5.0, float(areas.max())), (230, 126, 34)))
    return curves


def _draw_posed(draw: ImageDraw.ImageDraw, watched: Watched, top: int) -> int:
    """Draw where the board gave the camera's place and where not; the place below."""
    left, right = MARGIN + _LABEL_WIDTH, WIDTH - MARGIN
    bottom = top + _CURVE_HEIGHT // 2 - 4
    draw.rectangle([left, top, right, bottom], fill=(241, 241, 238))
    draw.text((MARGIN, (top + bottom) / 2), "board seen", fill=INK, font=_font(14), anchor="lm")
    xs = left + (right - left) * watched.looked_s / max(watched.seconds, 1e-3)
    for x, posed in zip(xs.tolist(), watched.posed.tolist(), strict=True):
        colour = LEVELS[Level.OK if posed else Level.BAD]
        draw.rectangle([min(x, right - 6), top + 3, min(x, right - 6) + 6, bottom - 3], fill=colour)
    return bottom + 8


def _draw_curves(draw: ImageDraw.ImageDraw, curves: list[Curve], watched: Watched, top: int) -> None:
    left, right = MARGIN + _LABEL_WIDTH, WIDTH - MARGIN
    total = max(watched.seconds, 1e-3)
    xs = left + (right - left) * watched.times / total
    y = top
    for name, values, low, high, colour in curves:
        bottom = y + _CURVE_HEIGHT - 8
        draw.rectangle([left, y, right, bottom], fill=(241, 241, 238))
        draw.text((MARGIN, (y + bottom) / 2), name, fill=INK, font=_font(14), anchor="lm")
        known = np.isfinite(values)
        ys = bottom - (bottom - y - 4) * np.clip((values[known] - low) / (high - low), 0, 1)
        line = list(zip(xs[known].tolist(), ys.tolist(), strict=True))
        if len(line) > 1:
            draw.polygon([(line[0][0], bottom), *line, (line[-1][0], bottom)], fill=_lighter(colour))
            draw.line(line, fill=colour, width=2, joint="curve")
        draw.text((right - 5, y + 3), f"0 to {high:.1f}", fill=FAINT, font=_font(12), anchor="ra")
        y += _CURVE_HEIGHT
    for second in range(int(total) + 1):
        x = left + (right - left) * second / total
        draw.line([(x, top), (x, y - 8)], fill=RULE)
        draw.text((x, y - 3), f"{second} s", fill=FAINT, font=_font(12), anchor="ma")


def _lighter(colour: Colour) -> Colour:
    red, green, blue = (round(0.25 * each + 0.75 * 241) for each in colour)
    return red, green, blue
