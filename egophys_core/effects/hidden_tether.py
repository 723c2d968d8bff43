"""A thread that ties a place of the object to an anchor, at the height where that place lay at rest."""

from typing import Any

import numpy as np

from egophys_core.effects.effect import Effect, Load, Parameter, Scene, Surroundings, Values
from egophys_core.effects.places import CORNERS, longest_axes, spread, weights_around
from egophys_core.effects.traits import Traits

PATCH_RADIUS = 0.01
"""Metres: the thread holds the nodes within about twice this."""


def load(values: Values, scene: Scene, memory: Any) -> tuple[Load, Any]:
    """The pull of the thread on the nodes it holds, m/s^2.

    Taken for the middle of the frame, so that a load held over the frame gives the tether no energy.
    """
    if memory is None:
        place = np.array([values["x"], values["y"], values["z"]])
        weights = weights_around(scene.rest_positions, place, PATCH_RADIUS)
        memory = weights, weights @ scene.positions + (values["anchor_x"], values["anchor_y"], 0.0)
    weights, anchor = memory
    offset = anchor - weights @ (scene.positions + 0.5 * scene.duration * scene.velocities)
    distance = float(np.linalg.norm(offset))
    if distance <= values["length"]:
        return Load(), memory
    pull = values["stiffness"] * (1.0 - values["length"] / distance) * offset
    return Load(acceleration=(scene.masses.sum() * weights / scene.masses)[:, None] * pull), memory


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """Tied at the middle or a corner of the object to where that lay, or at the middle to a place beside it.

    A thread does not pull at rest: it is as long as it is far to the anchor.
    """
    low, high = surroundings.rest_positions.min(axis=0), surroundings.rest_positions.max(axis=0)
    thread = {"stiffness": 2.0, "length": 0.02}
    snags = [
        {"x": float(x), "y": float(y), "z": float(z), "anchor_x": 0.0, "anchor_y": 0.0, **thread}
        for x, y, z in spread(low, high, CORNERS, reach=0.9, axes=longest_axes(high - low))
    ]
    beside = 0.5 * float((high - low).max())
    anchors = [(sign * beside * (axis == 0), sign * beside * (axis == 1)) for axis in (0, 1) for sign in (-1, 1)]
    return [*snags, *({**snags[0], "anchor_x": x, "anchor_y": y, "length": beside} for x, y in anchors)]


EFFECT = Effect(
    name="hidden_tether",
    summary="a thread, or a snag, that ties a place of the object to where that place lay at rest, or beside that",
    equation="F / M = stiffness max(|d| - length, 0) d / |d|, d = place at rest + anchor - place now",
    source="Antman, Nonlinear Problems of Elasticity (2005), ch. 3: strings pull and do not push",
    parameters=(
        *(Parameter(name=axis, unit="m", low=-3.0, high=3.0, step=0.03) for axis in ("x", "y", "z")),
        *(Parameter(name=f"anchor_{axis}", unit="m", low=-1.0, high=1.0, step=0.03) for axis in ("x", "y")),
        Parameter(name="stiffness", unit="1/s^2", low=0.0, high=100.0, step=2.0, null=0.0),
        Parameter(name="length", unit="m", low=0.0, high=1.0, step=0.02),
    ),
    traits=Traits(
        confounders=(
            "point_attraction",
            "place_dependent_friction",
            "table_adhesion",
            "uneven_mass",
            "constant_body_force",
        ),
        experiment="put it down somewhere else and repeat the motion: a snag stays behind, a lump comes along",
    ),
    starts=starts,
    load=load,
)
