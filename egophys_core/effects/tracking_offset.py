"""The hands are recorded beside where they are."""

import numpy as np

from egophys_core.effects.effect import Effect, Parameter, Surroundings, Values
from egophys_core.effects.traits import Need, Traits


def drive(values: Values, times: np.ndarray, controllers: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """The hands moved by the offset, all the time."""
    return controllers + np.array([values["x"], values["y"], values["z"]])


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"x": 0.005, "y": 0.005, "z": 0.005}]


EFFECT = Effect(
    name="tracking_offset",
    summary="the frame of the hands is displaced against that of the object",
    equation="c(t) = c_recorded(t) + (x, y, z)",
    source="Horn, J. Optical Society of America A 4 (1987) 629: translation between two records",
    parameters=tuple(
        Parameter(name=axis, unit="m", low=-0.1, high=0.1, step=0.005, null=0.0) for axis in ("x", "y", "z")
    ),
    traits=Traits(
        confounders=("gripper_offset", "tracking_rotation", "constant_body_force", "gravity_tilt", "uneven_mass"),
        experiment="touch three marks on the table with the gripper and compare them with where the camera sees them",
        needs=frozenset({Need.MOVING_GRIP, Need.FINE_NODES}),
    ),
    starts=starts,
    drive=drive,
)
