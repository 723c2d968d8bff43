"""A force on all of the object for some time: a gust."""

from typing import Any

import numpy as np

from egophys_core.discrepancy.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.discrepancy.effects.timing import LATEST, share_of_frame

WINDOWS = 5
"""Parts of the time of contact in which a gust is searched."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """The same acceleration for all nodes while the gust lasts, m/s^2; its mean over a frame in which it turns."""
    share = share_of_frame(scene, values["onset"], values["onset"] + values["duration"])
    if share == 0.0:
        return Load(), None
    acceleration = share * np.array([values["x"], values["y"], values["z"]])
    return Load(acceleration=np.broadcast_to(acceleration, scene.positions.shape)), None


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Gusts one after the other, from the first contact to the end."""
    duration = (surroundings.end - surroundings.contact_begins) / WINDOWS
    onsets = surroundings.contact_begins + duration * np.arange(WINDOWS)
    return [{"x": 0.5, "y": 0.5, "z": 0.5, "onset": float(onset), "duration": duration} for onset in onsets]


EFFECT = Effect(
    name="time_varying_body_force",
    summary="a force on every part of the object that begins and ends",
    equation="a = (x, y, z) for onset < t < onset + duration",
    source="Simiu and Scanlan, Wind Effects on Structures (1996): gusts",
    parameters=(
        *(Parameter(name=axis, unit="m/s^2", low=-10.0, high=10.0, step=0.5, null=0.0) for axis in ("x", "y", "z")),
        Parameter(name="onset", unit="s", low=0.0, high=LATEST, step=0.1),
        Parameter(name="duration", unit="s", low=0.05, high=LATEST, step=0.1),
    ),
    mimics=("constant_body_force", "grasp_slip", "hidden_tether", "point_attraction"),
    experiment="repeat the same motion: a gust comes at another time, or not at all",
    starts=starts,
    load=load,
)
