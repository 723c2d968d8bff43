"""The outline of a hand in a view: an ellipse on its outer edges, exact to a fraction of a pixel.

Fists, palms and mitts are nearly round, so most of their outline is near an ellipse; fingers, the arm and what covers
a part of it are left out as outliers. The narrower width tells the depth best: a body that is longer than it is wide
shows it unchanged while it turns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

RAYS = 96
"""Directions from the middle in which the edge is looked for."""

SPANS = (0.15, 0.15, 0.09, 0.09, 0.05, 0.05)
"""Share of the radius, to either side, in which it is looked for, in each round."""

STEP = 0.01
"""Of the radius, between samples along a ray."""

FEWEST_GREYS = 6.0
"""Grey levels between both sides of an edge."""

MISS_PX = 0.7
"""Pixels: scale of the robust weight of an edge."""

ON_OUTLINE_PX = 1.0
"""Pixels: an edge so near to the ellipse is part of the outline."""

FEWEST_EDGES = 25

LONGEST = 1.5
"""Largest ratio of the two widths: longer things are no hands but arms."""

ROUNDNESS, LIKENESS = 0.02, 0.2
"""Weight, per edge, of the wish to be a circle, or to keep the form of the view before: it decides where half of the
outline is hidden."""

BESIDE_PX = 2.5
"""Pixels: so far to either side of an edge it is asked whether a hand is there."""

WITHIN = 0.2
"""Weight of an edge that has a hand on both sides, as the end of an arm before a palm, or on none."""

LEAST_SUPPORT = 0.35
"""Share of the rays that must end on the outline; the arm and the object hide the others."""

FOUND_FILLED, FOLLOWED_FILLED = 0.85, 0.5
"""Share of the ellipse that must look like a hand where it is found, and where it is followed: there it may come before
things of its own colour."""

FILLED_WEIGHT = 4.0
LARGE_WEIGHT = 0.3
"""Of two ellipses that are found the fuller is the better one and, since an arm makes an edge within the hand, the
larger; against support."""

GROWTH = 0.06
"""Share by which a hand usually grows or shrinks from one view to the next."""

GROWTH_WEIGHT = 0.1
"""Against support, of two ellipses that are followed."""

STARTS = [(size, dx, dy) for size in (1.0, 1.2, 1.4) for dx in (-0.5, 0.0, 0.5) for dy in (-0.5, 0.0, 0.5)]
"""First guesses: times the half width of the arm's end; and beside its middle, in half widths."""


@dataclass(frozen=True, kw_only=True)
class HandOutline:
    """An ellipse in a view."""

    centre: np.ndarray
    """[2] pixel x, y."""
    form: np.ndarray
    """[2, 2] symmetric, 1 / pixels^2: places d from the centre with d form d = 1 are on it."""
    support: float
    """Share of the rays that end on it, 0..1."""
    filled: float = 1.0
    """Share of its inside that looks like a hand, 0..1."""

    @property
    def half_widths(self) -> tuple[float, float]:
        """Pixels: the narrower and the wider."""
        narrow, wide = np.linalg.eigvalsh(self.form)[::-1] ** -0.5
        return float(narrow), float(wide)

    @property
    def size(self) -> float:
        """Pixels: geometric mean of both half widths."""
        return float(np.linalg.det(self.form)) ** -0.25

    def mask(self, size: tuple[int, ...], scale: float = 1.0) -> np.ndarray:
        """[H, W] bool: its inside, made larger by a factor."""
        y, x = np.mgrid[: size[0], : size[1]]
        away: np.ndarray = np.stack([x - self.centre[0], y - self.centre[1]], axis=-1)
        return np.asarray(np.einsum("yxi,ij,yxj->yx", away, self.form, away) <= scale**2)


def find_outline(
    image: np.ndarray, looks_like_hand: np.ndarray, centre: np.ndarray, half_width: float
) -> HandOutline | None:
    """The outline of a hand of which only the end of its arm is known; None if it is not like an ellipse.

    Args:
        image: [S, S, 3] uint8, BGR.
        looks_like_hand: [S, S] float32, 0..1.
        centre: [2] pixel x, y, about the middle of the hand.
        half_width: pixels, about half of its width.
    """
    best, highest = None, -np.inf
    for size, dx, dy in STARTS:
        place, form = centre + half_width * np.array([dx, dy]), np.eye(2) / (size * half_width) ** 2
        found = _fit(image, looks_like_hand, HandOutline(centre=place, form=form, support=0.0), ROUNDNESS)
        if found is None or found.filled < FOUND_FILLED:
            continue
        larger = min(found.size / half_width, max(size for size, _, _ in STARTS))
        value = found.support + FILLED_WEIGHT * found.filled + LARGE_WEIGHT * larger
        if value > highest:
            best, highest = found, value
    return best


def follow_outline(
    image: np.ndarray, looks_like_hand: np.ndarray, before: HandOutline, moves: Sequence[np.ndarray]
) -> HandOutline | None:
    """The outline in the next view; None if it is lost.

    Args:
        image: [S, S, 3] uint8, BGR.
        looks_like_hand: [S, S] float32, 0..1.
        before: in the view before.
        moves: [2] pixels each, by which it may have moved since.
    """
    best, highest = None, -np.inf
    for move in moves:
        found = _fit(image, looks_like_hand, replace(before, centre=before.centre + move), LIKENESS)
        if found is None or found.filled < FOLLOWED_FILLED:
            continue
        value = likelihood(found, before)
        if value > highest:
            best, highest = found, value
    return best


def likelihood(outline: HandOutline, before: HandOutline) -> float:
    """The higher the likelier an outline is that of a hand which had another one in the view before."""
    return outline.support + outline.filled - GROWTH_WEIGHT * (np.log(outline.size / before.size) / GROWTH) ** 2


def _fit(image: np.ndarray, hand: np.ndarray, start: HandOutline, likeness: float) -> HandOutline | None:
    """Edges along rays from the middle, then an ellipse through them, again and again."""
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    rays = np.column_stack([np.cos(angle), np.sin(angle)])
    centre, form, support = start.centre, start.form, 0.0
    # In coordinates in which the first guess is a unit circle, what is wished for is a circle.
    whitening = np.linalg.cholesky(start.form).T
    for span in SPANS:
        radii = _radii(form, rays)
        edges, strength = _edges(image, hand, centre, rays, radii, span)
        known = strength > FEWEST_GREYS
        if known.sum() < FEWEST_EDGES:
            return None
        fitted = _robust_ellipse(edges[known], centre, whitening, likeness)
        if fitted is None or np.linalg.norm(fitted[0] - centre) > 0.3 * radii.mean():
            return None
        centre, form, missed = fitted
        support = np.count_nonzero(missed < ON_OUTLINE_PX) / RAYS
    if support < LEAST_SUPPORT:
        return None
    outline = HandOutline(centre=centre, form=form, support=support)
    return replace(outline, filled=_share_filled(outline, hand))


def _edges(
    image: np.ndarray, hand: np.ndarray, centre: np.ndarray, rays: np.ndarray, radii: np.ndarray, span: float
) -> tuple[np.ndarray, np.ndarray]:
    """[R, 2] pixels of the strongest edge on each ray near its radius, and [R] its strength in grey levels.

    An edge is that of a hand if a hand is within it and none outside.
    """
    shares = np.arange(1 - span, 1 + span, STEP)
    colours = _along(image, centre, rays, radii[:, None] * shares)
    smooth = cv2.GaussianBlur(colours, (7, 1), 1.7)
    contrast = np.linalg.norm(smooth[:, 4:] - smooth[:, :-4], axis=2)
    lengths = radii[:, None] * shares[2:-2]
    inside = _along(hand, centre, rays, lengths - BESIDE_PX)
    outside = _along(hand, centre, rays, lengths + BESIDE_PX)
    contrast = contrast * (WITHIN + (1 - WITHIN) * inside * (1 - outside))
    at, row = np.clip(contrast.argmax(axis=1), 1, contrast.shape[1] - 2), np.arange(len(rays))
    left, top, right = (contrast[row, at + beside] for beside in (-1, 0, 1))
    curvature = left - 2 * top + right
    beside = np.divide(0.5 * (left - right), curvature, out=np.zeros(len(rays)), where=np.abs(curvature) > 1e-6)
    share = shares[at + 2] + STEP * np.clip(beside, -1, 1)
    return centre + rays * (radii * share)[:, None], top


def _along(image: np.ndarray, centre: np.ndarray, rays: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """[R, L] or [R, L, C] float32: an image [S, S] or [S, S, C] at lengths [R, L] pixels along rays."""
    x, y = np.moveaxis((centre + rays[:, None] * lengths[..., None]).astype(np.float32), -1, 0)
    found = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32)


def _robust_ellipse(
    edges: np.ndarray, near: np.ndarray, whitening: np.ndarray, likeness: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Centre [2], form [2, 2] and distances [E] of edges [E, 2] from it, pixels; None if no ellipse fits."""
    weights, centre = np.ones(len(edges)), near
    for _ in range(10):
        solved = _ellipse((edges - centre) @ whitening.T, weights, likeness)
        if solved is None:
            return None
        centre = centre + np.linalg.solve(whitening, solved[0])
        form = whitening.T @ solved[1] @ whitening
        smaller, larger = np.linalg.eigvalsh(form)
        if larger > LONGEST**2 * smaller:
            return None
        away: np.ndarray = edges - centre
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        missed = np.abs(distance - _radii(form, away / distance[:, None]))
        weights = 1 / (1 + (missed / MISS_PX) ** 2) ** 2
    return centre, form, missed


def _ellipse(places: np.ndarray, weights: np.ndarray, likeness: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Centre [2] and form [2, 2] by weighted least squares of a x^2 + b x y + c y^2 + d x + e y = 1, [E, 2] places."""
    x, y = places.T
    root = np.sqrt(weights)
    rows = np.column_stack([x * x, x * y, y * y, x, y]) * root[:, None]
    round_ = np.sqrt(likeness * weights.sum()) * np.array([[1.0, 0, -1, 0, 0], [0, 1, 0, 0, 0]])
    a, b, c, d, e = np.linalg.lstsq(np.vstack([rows, round_]), np.append(root, [0.0, 0.0]), rcond=None)[0]
    quadratic = np.array([[a, b / 2], [b / 2, c]])
    if np.linalg.eigvalsh(quadratic)[0] <= 0:
        return None
    middle = -0.5 * np.linalg.solve(quadratic, [d, e])
    return middle, quadratic / (1 + middle @ quadratic @ middle)


def _radii(form: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """[R] pixels from the centre to the ellipse along unit vectors [R, 2]."""
    return np.asarray(np.einsum("ri,ij,rj->r", rays, form, rays) ** -0.5)


def _share_filled(outline: HandOutline, looks_like_hand: np.ndarray) -> float:
    """Share of the ellipse, less its rim, that looks like a hand; what is out of view does not."""
    wide = outline.half_widths[1]
    span = np.arange(-int(wide), int(wide) + 1)
    away: np.ndarray = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    inner = np.einsum("ni,ij,nj->n", away, outline.form, away) < 0.9**2
    places = np.rint(outline.centre + away[inner]).astype(int)
    there = ((places >= 0) & (places < looks_like_hand.shape[::-1])).all(axis=1)
    x, y = places[there].T
    return float(np.count_nonzero(looks_like_hand[y, x] > 0.5) / max(len(places), 1))
