"""What is tracked, object and hands alike, is recorded in a frame that is not level."""

import numpy as np

from egophys_core.effects.effect import Effect, Parameter, Surroundings, Values
from egophys_core.effects.rotations import rotation
from egophys_core.effects.traits import Measurement, Need, Traits


def frame(values: Values) -> np.ndarray:
    """The tilt. A turn about the vertical is not one of its numbers: nothing would show it."""
    return rotation(np.array([values["about_x"], values["about_y"], 0.0]))


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"about_x": 0.03, "about_y": 0.03}]


EFFECT = Effect(
    name="tracking_rotation",
    summary="the tracking frame is tilted against the world: object, hands and table appear turned about the origin",
    equation="p_recorded = R(about_x, about_y, 0) p",
    source="Horn, J. Optical Society of America A 4 (1987) 629: absolute orientation of two records",
    parameters=tuple(
        Parameter(name=name, unit="rad", low=-0.5, high=0.5, step=0.03, null=0.0) for name in ("about_x", "about_y")
    ),
    traits=Traits(
        confounders=("gravity_tilt", "tracking_scale", "tracking_offset", "constant_body_force"),
        experiment="let something flat lie on the table: in a turned frame it looks tilted, under tilted gravity level",
        needs=frozenset({Need.MOVING_GRIP}),
        measured_by=(Measurement.TABLE_LEVEL,),
        same_in_every_motion=True,
        equivalent_in_air=("gravity_tilt",),
    ),
    starts=starts,
    frame=frame,
)
