"""What perception knows of one view, for publishing, drawing and stacking into an episode."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from egophys_core.perception.stages import Masks, View


@dataclass(frozen=True, kw_only=True)
class HandSight:
    """One hand in one view."""

    pixel: np.ndarray
    """[2] x, y: the middle of the hand."""
    radius: float
    """Pixels: half of its width."""
    depth: float
    """Metres along the optical axis there, by its width; of a usual hand before it has contact."""
    grip: np.ndarray
    """[3] metres, frame world: where it holds or pushes the object; NaN before it has contact."""

    holds: bool
    """Whether it holds, rather than pushes, once it has contact."""

    is_led: bool = False
    """Whether what it holds tells better where it is than its outline does: a solid is known as a whole."""

    @property
    def has_contact(self) -> bool:
        """Whether the object has moved under it by now."""
        return bool(np.isfinite(self.grip).all())


@dataclass(frozen=True, kw_only=True)
class Observation:
    """Object and hand in one view."""

    view: View
    """Image and pose."""
    masks: Masks
    """Of the view."""
    points: np.ndarray
    """[N, 3] float64, metres, frame world: the tracked points of the object, in the same order in every view."""
    confidence: np.ndarray
    """[N] float64 in 0..1; 0 where nothing is known."""
    pixels: np.ndarray
    """[N, 2] float64, x and y: the points' places in the view."""
    visible: np.ndarray
    """[N] bool: seen in this view, not only inferred."""
    mesh_pixels: np.ndarray
    """[V, 2] float64: the vertices of the reconstructed surface in the view; NaN behind the camera."""
    mesh_edges: np.ndarray
    """[E, 2] int: its edges."""
    hand_points: np.ndarray
    """[C, 3] float64, metres, frame world: points of the hands, in the same order in every view; NaN where unknown."""
    hands: Mapping[int, HandSight]
    """The hands that are seen, by number."""
    hidden_points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """[H, 3] float64, metres, frame world: points of the side that is not seen at rest, inferred from symmetry."""
    hidden_confidence: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """[H] float64 in 0..1."""
