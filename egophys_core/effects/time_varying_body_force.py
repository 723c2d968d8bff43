"""A force on all of the object for some time: a gust."""

from itertools import product
from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.timing import LATEST, share_of_frame
from egophys_core.effects.traits import Traits

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


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """The same acceleration for all nodes while it lasts, m/s^2; of a frame in which it begins or ends, its share."""
    share = share_of_frame(scene, values["onset"], values["onset"] + values["duration"])
    if share == 0.0:
        return Load(), None
    now = share * swing(values, scene.time + 0.5 * scene.duration)
    acceleration = now * np.array([values["x"], values["y"], values["z"]])
    return Load(acceleration=np.broadcast_to(acceleration, scene.positions.shape)), None


def swing(values: Values, time: float | np.ndarray) -> Any:
    """-1..1: the force at times, seconds, over its largest."""
    return np.cos(2.0 * np.pi * values["frequency"] * (time - values["onset"]) - values["phase"])


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
        swing(start, fine) * ((fine > start["onset"]) & (fine < start["onset"] + start["duration"])) for start in starts
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
    load=load,
)
