"""The gripper holds beside the point that is recorded for it."""

import numpy as np

from egophys_core.effects.effect import Effect, Parameter, Surroundings, Values
from egophys_core.effects.hands import hands_of, turns
from egophys_core.effects.traits import Need, Traits


def drive(values: Values, times: np.ndarray, controllers: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """The hands moved by an offset that turns with them; its axes are the world's in the first frame."""
    offset = np.array([values["x"], values["y"], values["z"]])
    moved = controllers.copy()
    hands = hands_of(controllers)
    for hand in np.unique(hands):
        own = hands == hand
        moved[:, own] += (turns(controllers[:, own]) @ offset)[:, None]
    return moved


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"x": 0.005, "y": 0.005, "z": 0.005}]


EFFECT = Effect(
    name="gripper_offset",
    summary="the hand holds beside the point recorded for it, by an offset that turns with the hand",
    equation="c(t) = c_recorded(t) + R_hand(t) (x, y, z)",
    source="Tsai and Lenz, IEEE Trans. Robotics and Automation 5 (1989) 345: hand-eye calibration",
    parameters=tuple(
        Parameter(name=axis, unit="m", low=-0.1, high=0.1, step=0.005, null=0.0) for axis in ("x", "y", "z")
    ),
    traits=Traits(
        confounders=("tracking_offset", "tracking_rotation", "uneven_mass"),
        experiment="turn the wrist by 90 degrees while holding: the offset turns along, one of the tracking "
        "frame does not; then turn the object half round and grasp it anew: added mass turns along, an offset does not",
        needs=frozenset({Need.MOVING_GRIP, Need.FINE_NODES}),
    ),
    starts=starts,
    drive=drive,
)
