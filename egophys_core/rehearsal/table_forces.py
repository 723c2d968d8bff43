"""Injected forces where the body touches the table: adhesion, and friction that depends on place or speed."""

from collections.abc import Callable, Mapping

import numpy as np

from egophys_core.rehearsal.bodies import SKIN
from egophys_core.rehearsal.state import ForceTerm, StepState

BRISTLE_FREQUENCY = 300.0
"""rad/s of a vertex on its bristle: stiff enough that sticking looks like standing still."""


def table_adhesion(values: Mapping[str, float], areas: np.ndarray) -> ForceTerm:
    """A cohesive zone, strongest at height h = reach: F = -area stress (h / reach) exp(1 - h / reach).

    The stress is such that a body whose whole surface is at that height is pulled with `strength` times its mass.
    Source: Xu and Needleman 1993.
    """
    shares = areas / areas.sum()

    def add(state: StepState, forces: np.ndarray) -> None:
        height = np.maximum(state.positions[:, 2] - SKIN, 0.0) / values["reach"]
        forces[:, 2] -= values["strength"] * state.masses.sum() * shares * height * np.exp(1.0 - height)

    return add


def place_dependent_friction(values: Mapping[str, float], friction: float) -> ForceTerm:
    """The friction that one side of a patch has more than the other; the engine has that of the slippery side."""
    centre, change = np.array([values["x"], values["y"]]), values["change"]
    inside, outside = friction * max(change, 0.0), friction * max(-change, 0.0)

    def coefficients(state: StepState) -> np.ndarray:
        near = np.linalg.norm(state.positions[:, :2] - centre, axis=1) <= values["radius"]
        return np.where(near, inside, outside)

    return _bristles(coefficients)


def stribeck_friction(values: Mapping[str, float], friction: float) -> ForceTerm:
    """The friction that is there at low speed only: mu rise exp(-(v / speed)^2)."""

    def coefficients(state: StepState) -> np.ndarray:
        slip = np.sum(state.velocities[:, :2] ** 2, axis=1) / values["speed"] ** 2
        return friction * values["rise"] * np.exp(-slip)

    return _bristles(coefficients)


def _bristles(coefficients: Callable[[StepState], np.ndarray]) -> ForceTerm:
    """Dry friction as springs to places on the table that follow when the pull exceeds coefficient times pressure."""
    roots: np.ndarray | None = None

    def add(state: StepState, forces: np.ndarray) -> None:
        nonlocal roots
        places = state.positions[:, :2]
        if roots is None:
            roots = places.copy()
        stiffness = state.masses * BRISTLE_FREQUENCY**2
        pull = roots - places
        length = np.linalg.norm(pull, axis=1)
        longest = coefficients(state) * state.pressures / stiffness
        share = np.minimum(1.0, longest / np.maximum(length, 1e-12))
        roots = places + share[:, None] * pull
        forces[:, :2] += (stiffness * share)[:, None] * pull

    return add
