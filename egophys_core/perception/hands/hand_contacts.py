"""Which hands have begun to move the object, and where in space each of them acts on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.perception.hands.arms import SeenArm
from egophys_core.perception.hands.grip import (
    FEWEST_HELD,
    USUAL_HALF_WIDTH_M,
    HandGrip,
    covered_share,
    depth_by_width,
    take_grip,
)
from egophys_core.perception.hands.hand_points import at_depth
from egophys_core.perception.observation import HandSight
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_render import project

MOVED_M = 0.003
"""Metres from rest from which on a vertex that is seen counts as moved."""

FEWEST_MOVED = 5
LEAST_MOVED_SHARE = 0.25
"""Vertices near a hand that must have moved, and share of those seen there, before it is said to have contact."""

CONTACT_VIEWS = 3
"""Views in a row in which they have."""

HELD_SHARE = 0.12
"""Share of a hand that covers the object before that moves, where it holds it: 0.2 to 0.7; 0.01 where it pushes."""

COVERING_S = 0.22
"""Seconds for which it does, up to the view in which the object moves: a hand takes hold and then moves, one that
pushes comes over the object as that moves."""

TOUCHING_M = 0.04
"""Metres from the object, as seen from the camera, beyond which a hand does not touch it."""

NEAR_HAND_M = 0.12
"""Metres from where a hand holds or pushes: vertices that move there are moved by it."""

CARRIED_M = 0.06
"""Metres at rest from what a hand holds: what may move as that does."""

LET_GO_M = 0.04
"""Metres by which what a hand holds stays behind once it is let go."""


@dataclass(frozen=True, kw_only=True)
class HeldVertices:
    """Vertices of the object that go along with hands."""

    vertices: np.ndarray
    """[H] int."""
    places: np.ndarray
    """[H, 3] metres, frame world: where the hands have them."""


NOTHING_HELD = HeldVertices(vertices=np.zeros(0, int), places=np.zeros((0, 3)))


class HandContacts:
    """The hands' grips from view to view; a grip once taken is kept."""

    def __init__(self, rest: np.ndarray, *, is_solid: bool) -> None:
        """No hand has contact.

        Args:
            rest: [V, 3] metres, frame world: the object's vertices at rest.
            is_solid: whether the object is one. Then it is known better as a whole than by the hands that hold it.
        """
        self._rest, self._is_solid = rest, is_solid
        self._grips: dict[int, HandGrip] = {}
        self._nearly: dict[int, list[HandGrip]] = {}
        self._covered: dict[int, list[tuple[int, float]]] = {}

    def next(
        self,
        view: View,
        arms: Mapping[int, SeenArm],
        positions: np.ndarray,
        seen: np.ndarray,
        silhouette: Callable[[], np.ndarray],
    ) -> dict[int, HandSight]:
        """The hands in the next view, by number; without those whose size is told by something else than before.

        Args:
            view: its pose is known.
            arms: of the hands that are seen.
            positions: [W, 3] metres, frame world: the object's vertices, then points of its hidden side.
            seen: [V] bool: vertices of which something is seen in this view.
            silhouette: gives [S, S] bool, where the object is in this view, also behind hands.
        """
        places = project(positions[: len(self._rest)], view.camera_matrix, view.world_from_camera)
        moved = np.linalg.norm(positions[: len(self._rest)] - self._rest, axis=1) > MOVED_M
        self._let_go(view, arms, positions, seen)
        untouched = arms.keys() - self._grips.keys()
        shown = silhouette() if untouched else np.zeros((0, 0), bool)
        for number in untouched:
            arm = arms[number]
            covered = self._covered[number] = [
                *(each for each in self._covered.get(number, []) if view.stamp_ns - each[0] <= 1e9 * COVERING_S),
                (view.stamp_ns, covered_share(arm, shown)),
            ]
            if _is_touched(arm, places, seen, moved, view):
                nearly = self._nearly.setdefault(number, [])
                holds = min(share for _, share in covered) >= HELD_SHARE
                grip = take_grip(arm, shown, positions, places, view, holds=holds, is_solid=self._is_solid)
                nearly.append(grip)
                if len(nearly) == CONTACT_VIEWS:
                    # The earliest: there the object is nearest to where it lay.
                    self._grips[number] = nearly[0]
            else:
                self._nearly.pop(number, None)
        return {
            number: self._sight(arm, self._grips.get(number), view)
            for number, arm in arms.items()
            if number not in self._grips or self._grips[number].cue == arm.cue
        }

    def held(self, view: View, arms: Mapping[int, SeenArm]) -> HeldVertices:
        """Where in the next view the vertices are that hands hold, by what is seen of the hands."""
        held = [(grip.vertices, place + grip.beside) for _, grip, place in self._holds(view, arms)]
        return HeldVertices(
            vertices=np.concatenate([NOTHING_HELD.vertices, *(vertices for vertices, _ in held)]),
            places=np.vstack([NOTHING_HELD.places, *(places for _, places in held)]),
        )

    def _holds(self, view: View, arms: Mapping[int, SeenArm]) -> list[tuple[int, HandGrip, np.ndarray]]:
        """Number, grip and place [3] of the hands that hold a sheet, as far as they are seen."""
        known = {} if self._is_solid else self._grips
        return [
            (number, known[number], self._place(known[number], arm, view))
            for number, arm in arms.items()
            if number in known and known[number].holds and known[number].cue == arm.cue
        ]

    def _place(self, grip: HandGrip, arm: SeenArm, view: View) -> np.ndarray:
        """[3] metres, frame world: where a hand holds or pushes."""
        depth = depth_by_width(grip.half_width, arm, view)
        return np.asarray(at_depth(arm.centre[None], depth, view)[0] + grip.offset)

    def doubt(self, view: View, arms: Mapping[int, SeenArm], positions: np.ndarray) -> np.ndarray:
        """[V] metres: how far what hands hold is from where they have it, of vertices near that; 0 elsewhere.

        A sheet that a hand pushes together under itself seems to lie flat, as what is seen of it does.
        """
        found = np.zeros(len(self._rest))
        for _, grip, place in self._holds(view, arms):
            away = cKDTree(self._rest[grip.vertices]).query(self._rest)[0]
            behind = float(np.median(_behind(grip, place, positions)))
            found = np.maximum(found, np.where(away < CARRIED_M, behind, 0.0))
        return found

    def _let_go(self, view: View, arms: Mapping[int, SeenArm], positions: np.ndarray, seen: np.ndarray) -> None:
        """What is seen to stay behind is held no more."""
        for number, grip, place in self._holds(view, arms):
            behind = _behind(grip, place, positions)[seen[grip.vertices]]
            if len(behind) >= FEWEST_HELD and np.median(behind) > LET_GO_M:
                self._grips[number] = replace(grip, holds=False)

    def _sight(self, arm: SeenArm, grip: HandGrip | None, view: View) -> HandSight:
        depth = depth_by_width(USUAL_HALF_WIDTH_M if grip is None else grip.half_width, arm, view)
        place = np.full(3, np.nan) if grip is None else self._place(grip, arm, view)
        holds = grip is not None and grip.holds
        return HandSight(
            pixel=arm.centre,
            radius=arm.radius,
            depth=depth,
            grip=place,
            holds=holds,
            is_led=holds and self._is_solid,
        )


def _behind(grip: HandGrip, place: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """[H] metres: how far what a hand at a place [3] holds is from where the hand has it."""
    return np.asarray(np.linalg.norm(positions[grip.vertices] - place - grip.beside, axis=1))


def _is_touched(arm: SeenArm, places: np.ndarray, seen: np.ndarray, moved: np.ndarray, view: View) -> bool:
    away = np.linalg.norm(places[:, :2] - arm.grip, axis=1) * places[:, 2] / view.camera_matrix[0, 0]
    near = seen & (away < NEAR_HAND_M)
    count = np.count_nonzero(near & moved)
    return bool(
        away.min() <= TOUCHING_M and count >= FEWEST_MOVED and count >= LEAST_MOVED_SHARE * np.count_nonzero(near)
    )
