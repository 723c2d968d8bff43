"""Episodes of a small sheet by our own simulator, with and without an effect: quick, and with a known answer."""

from dataclasses import replace
from functools import cache

from egophys_core.effects import TwinEffect
from egophys_core.episode import Episode
from egophys_core.twin import ObjectModel
from tests.identification.synthetic import known_model, make_episode, sheet_shape

NOISE_M = 0.0015

WIND = TwinEffect(name="constant_body_force", values={"x": 1.5, "y": -1.0, "z": 0.0})


@cache
def sheet() -> ObjectModel:
    """A sheet of 36 nodes."""
    return known_model(sheet_shape(6))


def episodes(*effects: TwinEffect, noise_m: float = NOISE_M) -> list[Episode]:
    """Two motions of the sheet under effects."""
    model = replace(sheet(), effects=effects)
    carries = {"lift": (0.06, 0.04, 0.25), "swing": (-0.15, 0.12, 0.2)}
    return [
        make_episode(model, name=name, duration=3.2, carry=carry, noise_m=noise_m) for name, carry in carries.items()
    ]


def away() -> Episode:
    """A third motion of the sheet."""
    return make_episode(sheet(), name="away", duration=3.2, carry=(-0.1, -0.1, 0.2), noise_m=NOISE_M)


def fallen() -> Episode:
    """The third motion, in which the sheet suddenly goes elsewhere: its twin does not."""
    points = away().points.copy()
    points[len(points) // 3 :, :, 0] += 0.15
    return replace(away(), name="fallen", points=points)
