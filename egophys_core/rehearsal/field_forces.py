"""Injected forces that act through space: drag, body forces, attraction, a tether."""

from collections.abc import Mapping

import numpy as np

from egophys_core.rehearsal.state import ForceTerm, StepState

TETHER_PATCH = 0.03
"""Metres around a tether's place over which its pull is spread, so that it does not tear one vertex out."""


def quadratic_drag(values: Mapping[str, float]) -> ForceTerm:
    """F = -m c |v| v."""

    def add(state: StepState, forces: np.ndarray) -> None:
        speeds = np.linalg.norm(state.velocities, axis=1)
        forces -= (values["coefficient"] * state.masses * speeds)[:, None] * state.velocities

    return add


def constant_body_force(values: Mapping[str, float]) -> ForceTerm:
    """F = m a."""
    acceleration = _acceleration(values)

    def add(state: StepState, forces: np.ndarray) -> None:
        forces += state.masses[:, None] * acceleration

    return add


def time_varying_body_force(values: Mapping[str, float]) -> ForceTerm:
    """F = m a cos(2 pi f (t - onset) - phase) while it lasts."""
    acceleration = _acceleration(values)

    def add(state: StepState, forces: np.ndarray) -> None:
        since = state.time - values["onset"]
        if 0.0 < since < values["duration"]:
            swing = np.cos(2.0 * np.pi * values["frequency"] * since - values["phase"])
            forces += swing * state.masses[:, None] * acceleration

    return add


def point_attraction(values: Mapping[str, float]) -> ForceTerm:
    """The force of a well of Gaussian shape around a point."""
    point = np.array([values["x"], values["y"], values["z"]])

    def add(state: StepState, forces: np.ndarray) -> None:
        away = (point - state.positions) / values["range"]
        well = values["strength"] * np.exp(0.5 - 0.5 * np.sum(away**2, axis=1))
        forces += (state.masses * well)[:, None] * away

    return add


def hidden_tether(values: Mapping[str, float], resting: np.ndarray) -> ForceTerm:
    """A slack thread from a place on the resting body `resting` [V, 3] to an anchor beside it, at its height.

    The stiffness is over the body's mass.
    """
    place = np.array([values["x"], values["y"], values["z"]])
    anchor = place + np.array([values["anchor_x"], values["anchor_y"], 0.0])
    distances = np.linalg.norm(resting - place, axis=1)
    tied = np.flatnonzero(distances <= max(TETHER_PATCH, distances.min()))

    def add(state: StepState, forces: np.ndarray) -> None:
        to_anchor = anchor - state.positions[tied].mean(axis=0)
        distance = float(np.linalg.norm(to_anchor))
        if distance > max(values["length"], 1e-6):
            pull = values["stiffness"] * state.masses.sum() * (distance - values["length"])
            forces[tied] += pull * to_anchor / distance / len(tied)

    return add


def _acceleration(values: Mapping[str, float]) -> np.ndarray:
    return np.array([values["x"], values["y"], values["z"]])
