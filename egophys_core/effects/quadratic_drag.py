"""Air that resists with the square of the speed."""

import numpy as np
import warp as wp

from egophys_core.constants import GRAVITY
from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.traits import Measurement, Traits
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays

SMALLEST_SPEED = 1e-9
"""m/s: guards the slope of the speed at rest."""

SHORTEST = 1e-9
"""Seconds: guards the division by the duration of a substep that a rollout does not take."""


@wp.func
def add_drag(
    group: int,
    first: int,
    last: int,
    column: int,
    time: Lanes,
    dt: Lanes,
    state: StateArrays,
    parameters: ParameterArrays,
    numbers: wp.array2d(dtype=Lanes),
    forces: wp.array3d(dtype=Lanes),
):
    """Add -m c |v| v, N; numbers: c, 1/m. At most what stops a node within the substep: drag never turns it round."""
    coefficient = numbers[group, column]
    for node in range(first, last):
        vx = state.velocities[group, node, 0]
        vy = state.velocities[group, node, 1]
        vz = state.velocities[group, node, 2]
        squared = wp.cw_mul(vx, vx) + wp.cw_mul(vy, vy) + wp.cw_mul(vz, vz)
        rate = Lanes()
        for lane in range(LANES):
            speed = wp.sqrt(wp.max(squared[lane], SMALLEST_SPEED * SMALLEST_SPEED))
            rate[lane] = wp.min(coefficient[lane] * speed, 1.0 / wp.max(dt[lane], SHORTEST))
        rate = wp.cw_mul(parameters.masses[group, node], rate)
        forces[group, node, 0] -= wp.cw_mul(rate, vx)
        forces[group, node, 1] -= wp.cw_mul(rate, vy)
        forces[group, node, 2] -= wp.cw_mul(rate, vz)


def numbers(values: Values, body: Body) -> np.ndarray:
    """[1] c, 1/m."""
    return np.array([values["coefficient"]])


def damping_rate(numbers: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """[K] 1/s: the slope of c |v| v."""
    return 2.0 * numbers[:, 0] * speeds


def falls(values: Values) -> np.ndarray:
    """[5] falls less and less fast."""
    return np.array([0.0, 0.0, -GRAVITY, values["coefficient"], 0.0])


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"coefficient": 2.0}]


EFFECT = Effect(
    name="quadratic_drag",
    summary="air drag that grows with the square of the speed",
    equation="a = -c |v| v",
    source="Batchelor, An Introduction to Fluid Dynamics (1967), sec. 5.11; c = rho C_d A / (2 m)",
    parameters=(Parameter(name="coefficient", unit="1/m", low=0.0, high=60.0, step=2.0, null=0.0),),
    traits=Traits(
        confounders=("bending_damping", "viscoelasticity", "control_delay"),
        experiment="hold it by one corner and swing it at two speeds in still air: drag is fourfold at twice the speed",
        measured_by=(Measurement.FREE_FALL,),
        same_in_every_motion=True,
    ),
    starts=starts,
    falls=falls,
    node_force=NodeForce(function=add_drag, numbers=numbers, damping_rate=damping_rate),
)
