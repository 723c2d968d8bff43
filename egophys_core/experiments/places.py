"""Where hands take hold of an object at rest."""

import numpy as np

from egophys_core.errors import PlanningError
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel

INSET_M = 0.012
"""Metres from the corner of a sheet inwards."""

FROM_MIDDLE = 0.3
"""Of a solid's length, from its middle."""

DEPTH_M = 0.025
"""Metres below its top at which the middle of a hand holds a solid, at most half its height. A hand that holds its skin
alone is a pivot, about which a toy turns as no twin foretells: 5.8 mm off when it hangs still, 2.5 mm held so deep."""

UNDER_HAND_M = 0.03
"""Metres about a place within which the highest node is where a hand meets the object from above."""


def axes_at_rest(model: ObjectModel) -> np.ndarray:
    """[2, 3] horizontal unit vectors: along the object as it lies, and across."""
    spread = model.graph.positions[:, :2].astype(np.float64)
    along = np.linalg.eigh(np.cov((spread - spread.mean(axis=0)).T))[1][:, 1]
    along = along * (1.0 if along[np.argmax(np.abs(along))] > 0.0 else -1.0)
    return np.array([[along[0], along[1], 0.0], [-along[1], along[0], 0.0]])


def extents(model: ObjectModel) -> np.ndarray:
    """[3] metres: along, across, and upwards, at rest."""
    nodes = model.graph.positions.astype(np.float64)
    return np.ptp(nodes @ np.vstack([axes_at_rest(model), [0.0, 0.0, 1.0]]).T, axis=0)


def places_to_hold(model: ObjectModel, hands: int, held: np.ndarray) -> np.ndarray:
    """[H, 3] metres: two corners at the ends of a long side of a sheet, else two places on top; or one of them.

    Of a solid that is the one where it was not held before: what differs from end to end shows where it hangs from
    both. Of a sheet it is the first: how it is pinched differs from corner to corner, which passes for an offset of
    hands.

    Args:
        held: [C, 3] metres, where it was held; may be empty.

    Raises:
        PlanningError: it does not lie on a table for hands to take it.
    """
    if model.graph.positions.shape[0] == 0 or kind_of(model).from_surface is None:
        raise PlanningError(
            f"experiments are for what lies on a table and is seen all over; a {kind_of(model).name} is held in "
            "clamps: record another load, or another motion of its clamps"
        )
    nodes, axes = model.graph.positions.astype(np.float64), axes_at_rest(model)
    flat = kind_of(model).lies_flat
    centre = (nodes.max(axis=0) + nodes.min(axis=0)) / 2.0
    along, across = (nodes - centre) @ axes.T[:, 0], (nodes - centre) @ axes.T[:, 1]
    found = []
    for sign in (1.0, -1.0):
        if flat:
            corner = nodes[np.argmax(sign * along / np.ptp(along) - across / np.ptp(across))]
            inwards = (centre - corner) * [1.0, 1.0, 0.0]
            place = corner + INSET_M * np.sqrt(2.0) * inwards / np.linalg.norm(inwards)
        else:
            place = centre + sign * FROM_MIDDLE * np.ptp(along) * axes[0]
        near = np.linalg.norm(nodes[:, :2] - place[:2], axis=1) <= UNDER_HAND_M
        if near.any():
            top = nodes[near, 2].max()
            place[2] = top if flat else max(top - DEPTH_M, centre[2])
        found.append(place)
    if hands == 2 or flat:
        return np.array(found[:hands])
    return np.array([found[int(np.argmax([distance_to(held, each) for each in found]))]])


def distance_to(held: np.ndarray, place: np.ndarray) -> float:
    """Metres from a place [3] to the nearest of where it was held, [C, 3]; infinite where that is nowhere."""
    return float(np.linalg.norm(held - place, axis=1).min(initial=np.inf))
