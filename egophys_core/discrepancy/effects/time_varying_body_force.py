"""A force on all of the object for some time: a gust."""

from typing import Any

import numpy as np

from egophys_core.discrepancy.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.discrepancy.effects.timing import LATEST, share_of_frame

WINDOWS = 5
"""Parts of the time of contact in which a gust is searched."""

FREQUENCIES_HZ = tuple(0.1 * tenths for tenths in range(2, 11))
"""Of the oscillations that are searched: over five seconds neighbours differ by half a turn, which a refit bridges."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """The same acceleration for all nodes while it lasts, m/s^2; of a frame in which it begins or ends, its share."""
    share = share_of_frame(scene, values["onset"], values["onset"] + values["duration"])
    if share == 0.0:
        return Load(), None
    since = scene.time + 0.5 * scene.duration - values["onset"]
    now = share * np.cos(2.0 * np.pi * values["frequency"] * since - values["phase"])
    acceleration = now * np.array([values["x"], values["y"], values["z"]])
    return Load(acceleration=np.broadcast_to(acceleration, scene.positions.shape)), None


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Gusts one after the other, from the first contact to the end, and oscillations all along."""
    begins, lasts = surroundings.contact_begins, surroundings.end - surroundings.contact_begins
    size = {"x": 0.5, "y": 0.5, "z": 0.5}
    gusts: list[dict[str, float]] = [
        {**size, "onset": begins + index * lasts / WINDOWS, "duration": lasts / WINDOWS, "frequency": 0.0, "phase": 0.0}
        for index in range(WINDOWS)
    ]
    oscillations = [
        {**size, "onset": begins, "duration": lasts, "frequency": frequency, "phase": phase}
        for frequency in FREQUENCIES_HZ
        for phase in (0.0, np.pi / 2)
    ]
    return [*gusts, *oscillations]


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
    mimics=("constant_body_force", "grasp_slip", "hidden_tether", "point_attraction"),
    experiment="repeat the same motion: a gust comes at another time, or not at all",
    starts=starts,
    load=load,
)
