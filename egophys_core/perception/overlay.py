"""What perception found in a view, drawn over its image: masks, tracks, the reprojected mesh, confidence."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from egophys_core.perception.observation import Observation
from egophys_core.perception.overlay_window import Window
from egophys_core.perception.stages import Masks
from egophys_core.perception.surface.surface_render import project

OBJECT_COLOUR = (90, 190, 60)
"""BGR, as all colours here."""
HAND_COLOUR = (40, 130, 255)
MESH_COLOUR = (255, 255, 255)
CONTROLLER_COLOUR = (255, 60, 255)
WARNING_COLOUR = (60, 60, 255)

DRAWN_POINTS = 300
"""More would hide the object; those drawn are the same ones in every view."""
TAIL_VIEWS = 6
"""Views over which a track's tail reaches back."""

_TINT, _WIRE = 0.25, 0.35
_CONFIDENCE_COLOURS = np.array([[40, 40, 215], [80, 200, 255], [255, 170, 40]], float)
_SUBPIXEL_BITS = 4
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_picture(
    observation: Observation, *, window: Window, tails: Sequence[np.ndarray] = (), label: str = ""
) -> np.ndarray:
    """[S, 2 S, 3] uint8 BGR: the whole view with the masks on the left, the window on the right.

    Args:
        observation: what to draw; its arrays are not changed.
        window: the part of the view that is magnified, framed on the left.
        tails: pixels [N, 2] of the same points in the views before, oldest first; NaN breaks a tail.
        label: written into the upper left corner; ASCII.
    """
    view = draw_masks(observation)
    (x0, y0), (x1, y1) = np.rint([window.corner, window.corner + window.side]).astype(int).tolist()
    cv2.rectangle(view, (x0, y0), (x1, y1), (255, 255, 255), 1)
    write_text(view, label, (8, 18))
    if not np.isfinite(observation.view.world_from_camera).all():
        write_text(view, "camera pose not known", (8, 38), WARNING_COLOUR)
    side = view.shape[0]
    closer = draw_tracks(zoomed(observation, window), tails=[window.magnified(each, side) for each in tails])
    return np.hstack([view, closer])


def zoomed(observation: Observation, window: Window) -> Observation:
    """The observation as a camera would have it that sees the window alone, at the size of the view."""
    side = observation.view.image.shape[0]
    matrix = window.matrix(side)

    def warped(image: np.ndarray, flags: int) -> np.ndarray:
        return np.asarray(cv2.warpAffine(image, matrix, (side, side), flags=flags))

    camera_matrix = np.vstack([matrix, [0, 0, 1]]) @ observation.view.camera_matrix
    masks = (warped(each.astype(np.uint8), cv2.INTER_NEAREST) > 0 for each in _both(observation.masks))
    object_mask, hand_mask = masks
    return replace(
        observation,
        view=replace(
            observation.view, image=warped(observation.view.image, cv2.INTER_LINEAR), camera_matrix=camera_matrix
        ),
        masks=Masks(object=object_mask, hand=hand_mask),
        pixels=window.magnified(observation.pixels, side),
        mesh_pixels=window.magnified(observation.mesh_pixels, side),
    )


def draw_masks(observation: Observation) -> np.ndarray:
    """[S, S, 3] uint8 BGR: the view with object and hand tinted and outlined, and crosses at the points of the hand."""
    image = observation.view.image.copy()
    for mask, colour in zip(_both(observation.masks), (OBJECT_COLOUR, HAND_COLOUR), strict=True):
        image[mask] = np.rint((1 - _TINT) * image[mask] + _TINT * np.array(colour)).astype(np.uint8)
    _draw_outlines(image, observation)
    _draw_hand_points(image, observation)
    return image


def draw_tracks(observation: Observation, *, tails: Sequence[np.ndarray] = ()) -> np.ndarray:
    """[S, S, 3] uint8 BGR: the view with the outlines of the masks, the mesh as a thin wire, and the tracks.

    A point is a dot in the colour of its confidence, with a tail where it was before; a small ring where it is not seen
    but inferred. Points of the hand are crosses.

    Args:
        observation: what to draw; its arrays are not changed.
        tails: pixels [N, 2] of the same points in the views before, oldest first; NaN breaks a tail.
    """
    image = observation.view.image.copy()
    _draw_mesh(image, observation)
    _draw_outlines(image, observation)
    drawn = _drawn_points(len(observation.points))
    colours = confidence_colours(observation.confidence)[drawn].tolist()
    paths = np.stack([*tails, observation.pixels], axis=1)[drawn]
    for path, colour in zip(paths, colours, strict=True):
        segments = _drawable(np.stack([path[:-1], path[1:]], axis=1), image)
        if len(segments):
            cv2.polylines(image, list(_fixed_point(segments)), False, colour, 1, cv2.LINE_AA, _SUBPIXEL_BITS)
    is_known = _is_drawable(observation.pixels[drawn], image) & (observation.confidence[drawn] > 0)
    for index in np.flatnonzero(is_known):
        place = _fixed_point(observation.pixels[drawn[index]]).tolist()
        radius, thickness = (40, -1) if observation.visible[drawn[index]] else (36, 1)
        cv2.circle(image, place, radius, colours[index], thickness, cv2.LINE_AA, _SUBPIXEL_BITS)
    _draw_hand_points(image, observation)
    return image


def confidence_colours(confidence: np.ndarray) -> np.ndarray:
    """[N, 3] uint8 BGR of confidences [N]: red at 0, yellow at 0.5, blue at 1 (told apart by the colour-blind)."""
    at = np.clip(np.nan_to_num(confidence), 0, 1)
    channels = [np.interp(at, (0, 0.5, 1), _CONFIDENCE_COLOURS[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def write_text(
    image: np.ndarray, text: str, place: tuple[int, int], colour: tuple[int, int, int] = (255, 255, 255)
) -> None:
    """Write into an image [H, W, 3], its lower left corner at x and y, with a dark rim so that it shows on anything."""
    cv2.putText(image, text, place, _FONT, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(image, text, place, _FONT, 0.5, colour, 1, cv2.LINE_AA)


def legend(width: int) -> np.ndarray:
    """[32, width, 3] uint8: what the colours and signs mean; cut where it is wider."""
    strip = np.full((32, max(width, 800), 3), 40, np.uint8)
    x = 10
    for colour, text in ((OBJECT_COLOUR, "object"), (HAND_COLOUR, "hand")):
        cv2.rectangle(strip, (x, 10), (x + 14, 22), colour, -1)
        x = _beside(strip, text, x + 20)
    cv2.line(strip, (x, 16), (x + 16, 16), MESH_COLOUR, 1, cv2.LINE_AA)
    x = _beside(strip, "surface", x + 22)
    cv2.drawMarker(strip, (x + 6, 16), CONTROLLER_COLOUR, cv2.MARKER_CROSS, 10, 1, cv2.LINE_AA)
    x = _beside(strip, "hand points", x + 18)
    cv2.circle(strip, (x + 5, 16), 3, (255, 255, 255), -1, cv2.LINE_AA)
    x = _beside(strip, "seen", x + 14)
    cv2.circle(strip, (x + 5, 16), 3, (255, 255, 255), 1, cv2.LINE_AA)
    x = _beside(strip, "inferred", x + 14)
    x = _beside(strip, "confidence 0", x)
    strip[10:22, x : x + 80] = confidence_colours(np.linspace(0, 1, 80))
    _beside(strip, "1", x + 86)
    return strip[:, :width]


def _beside(strip: np.ndarray, text: str, x: int) -> int:
    """Write a text from x on and return where the next sign goes."""
    write_text(strip, text, (x, 21))
    return x + int(cv2.getTextSize(text, _FONT, 0.5, 1)[0][0]) + 18


def _both(masks: Masks) -> tuple[np.ndarray, np.ndarray]:
    return masks.object, masks.hand


def _draw_outlines(image: np.ndarray, observation: Observation) -> None:
    for mask, colour in zip(_both(observation.masks), (OBJECT_COLOUR, HAND_COLOUR), strict=True):
        contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(image, contours, -1, colour, 1, cv2.LINE_AA)


def _draw_mesh(image: np.ndarray, observation: Observation) -> None:
    """Blend the wire over the image, so that the texture stays visible."""
    if len(observation.mesh_edges) == 0:
        return
    segments = _drawable(observation.mesh_pixels[observation.mesh_edges], image)
    wired = image.copy()
    cv2.polylines(wired, list(_fixed_point(segments)), False, MESH_COLOUR, 1, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.addWeighted(wired, _WIRE, image, 1 - _WIRE, 0, dst=image)


def _draw_hand_points(image: np.ndarray, observation: Observation) -> None:
    view = observation.view
    if not np.isfinite(view.world_from_camera).all():
        return
    known = observation.hand_points[np.isfinite(observation.hand_points).all(axis=1)]
    projected = project(known, view.camera_matrix, view.world_from_camera)
    for x, y in _drawable(projected[projected[:, 2] > 0, :2], image):
        place = (round(float(x)), round(float(y)))
        cv2.drawMarker(image, place, CONTROLLER_COLOUR, cv2.MARKER_CROSS, 7, 1, cv2.LINE_AA)


def _drawn_points(count: int) -> np.ndarray:
    """Ids of at most `DRAWN_POINTS` of so many points, whatever their order; the same for the same count."""
    return np.sort(np.random.default_rng(0).permutation(count)[:DRAWN_POINTS])


def _is_drawable(places: np.ndarray, image: np.ndarray) -> np.ndarray:
    """[N] bool: all coordinates of places [N, ...] finite and not so far outside that OpenCV's integers overflow."""
    near = np.isfinite(places) & (np.abs(np.nan_to_num(places)) < 4 * max(image.shape[:2]))
    return np.asarray(near.all(axis=tuple(range(1, places.ndim))))


def _drawable(places: np.ndarray, image: np.ndarray) -> np.ndarray:
    return places[_is_drawable(places, image)]


def _fixed_point(places: np.ndarray) -> np.ndarray:
    """Pixels as the integers that OpenCV draws at a sixteenth of a pixel."""
    return np.rint(places * (1 << _SUBPIXEL_BITS)).astype(np.int32)
