"""A force on all of the object for some time: a gust."""

from itertools import product

import numpy as np
import warp as wp

from egophys_core.effects.effect import Body, Effect, NodeForce, Parameter, Surroundings, Values
from egophys_core.effects.timing import LATEST
from egophys_core.effects.traits import Traits
from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays

PIECES = 12
"""Parts of the time of contact that are simulated; gusts and oscillations are sums of them."""

GUSTS = (1, 2, 4)
"""Parts that a gust lasts for which is searched, beside one that lasts to the end."""

FREQUENCIES_HZ = tuple(0.1 * tenths for tenths in range(2, 11))
"""Of the oscillations that are searched: over five seconds neighbours differ by half a turn, which a refit bridges."""

PHASES = tuple(np.pi / 4 * eighths for eighths in range(4))
"""Of those, in radians; half a turn more is the opposite force."""

ONSETS = (0, 2, 4, 6)
"""Parts after the first contact at which they begin."""

SIZE = {"x": 0.5, "y": 0.5, "z": 0.5}


SHORTEST = 1e-9
"""Seconds: guards the division by the duration of a substep that a rollout does not take."""


@wp.func
def add_gust(
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
    """Add m a(t), N, of a substep in which it begins or ends for its share.

    Numbers: a, m/s^2; when it begins and ends, seconds since the start of the rollout; 2 pi frequency, rad/s; phase.
    """
    now = Lanes()
    for lane in range(LANES):
        after = numbers[group, column + 3][lane] - time[lane]
        left = numbers[group, column + 4][lane] - time[lane]
        lasts = wp.max(wp.min(left, dt[lane]) - wp.max(after, 0.0), 0.0)
        angle = numbers[group, column + 5][lane] * (0.5 * dt[lane] - after) - numbers[group, column + 6][lane]
        now[lane] = lasts / wp.max(dt[lane], SHORTEST) * wp.cos(angle)
    x = wp.cw_mul(now, numbers[group, column])
    y = wp.cw_mul(now, numbers[group, column + 1])
    z = wp.cw_mul(now, numbers[group, column + 2])
    for node in range(first, last):
        mass = parameters.masses[group, node]
        forces[group, node, 0] += wp.cw_mul(mass, x)
        forces[group, node, 1] += wp.cw_mul(mass, y)
        forces[group, node, 2] += wp.cw_mul(mass, z)


def numbers(values: Values, body: Body) -> np.ndarray:
    """[7] what `add_gust` reads."""
    begins = values["onset"] - body.begins
    ends = begins + values["duration"]
    pulsation = 2.0 * np.pi * values["frequency"]
    return np.array([values["x"], values["y"], values["z"], begins, ends, pulsation, values["phase"]])


def oscillation(values: Values, time: np.ndarray) -> np.ndarray:
    """-1..1: the force at times, seconds, over its largest."""
    return np.asarray(np.cos(2.0 * np.pi * values["frequency"] * (time - values["onset"]) - values["phase"]))


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Gusts one after the other, and oscillations from some time on to the end."""
    times = _piece_times(surroundings)
    steady = {"frequency": 0.0, "phase": 0.0}
    spans = sorted({(first, min(first + count, PIECES)) for first in range(PIECES) for count in (*GUSTS, PIECES)})
    gusts = [{**SIZE, **_window(times, first, last), **steady} for first, last in spans]
    oscillations = [
        {**SIZE, **_window(times, onset, PIECES), "frequency": frequency, "phase": phase}
        for onset, frequency, phase in product(ONSETS, FREQUENCIES_HZ, PHASES)
    ]
    return [*gusts, *oscillations]


def superposition(
    surroundings: Surroundings, starts: list[dict[str, float]]
) -> tuple[list[dict[str, float]], np.ndarray]:
    """Steady forces for a part of the time each; a start has of each its own mean over that part."""
    times = _piece_times(surroundings)
    pieces = [{**SIZE, **_window(times, index, index + 1), "frequency": 0.0, "phase": 0.0} for index in range(PIECES)]
    fine = np.linspace(times[0], times[-1], 20 * PIECES, endpoint=False) + (times[1] - times[0]) / 40.0
    shares = [
        oscillation(start, fine) * ((fine > start["onset"]) & (fine < start["onset"] + start["duration"]))
        for start in starts
    ]
    return pieces, np.reshape(shares, (len(starts), PIECES, -1)).mean(axis=2)


def _piece_times(surroundings: Surroundings) -> np.ndarray:
    """[PIECES + 1] seconds: where the pieces begin and end."""
    return np.linspace(surroundings.contact_begins, surroundings.end, PIECES + 1)


def _window(times: np.ndarray, first: int, last: int) -> dict[str, float]:
    return {"onset": float(times[first]), "duration": float(times[last] - times[first])}


EFFECT = Effect(
    name="time_varying_body_force",
    summary="a force on every part of the object that comes and goes: a gust, or one that swings to and fro",
    equation="a = (x, y, z) cos(2 pi frequency (t - onset) - phase) for onset < t < onset + duration",
    source="Simiu and Scanlan, Wind Effects on Structures (1996): gusts and vortex shedding",
    parameters=(
        *(Parameter(name=axis, unit="m/s^2", low=-10.0, high=10.0, step=0.5, null=0.0) for axis in ("x", "y", "z")),
        Parameter(name="onset", unit="s", low=0.0, high=LATEST, step=0.1),
        Parameter(name="duration", unit="s", low=0.05, high=LATEST, step=0.1),
        Parameter(name="frequency", unit="Hz", low=0.0, high=5.0, step=0.05),
        Parameter(name="phase", unit="rad", low=-np.pi, high=np.pi, step=0.3),
    ),
    traits=Traits(
        confounders=("constant_body_force", "grasp_slip", "hidden_tether", "point_attraction"),
        experiment="repeat the same motion: a gust comes at another time, or not at all",
        special_cases=("constant_body_force", "gravity_tilt", "gravity_scale"),
    ),
    starts=starts,
    superposition=superposition,
    node_force=NodeForce(function=add_gust, numbers=numbers),
)
