"""Injected added mass against the equation of motion, in steps of the world's size."""

import numpy as np
import pytest

from egophys_core.rehearsal.bodies import make_body
from egophys_core.rehearsal.carried_air import added_mass
from egophys_core.rehearsal.options import RehearsalObject, RehearsalOptions
from egophys_core.rehearsal.state import StepState

STEP_S = 5e-4


@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("push", [[0.0, 0.0, -9.81], [2.0, 1.0, 0.0], [3.0, 0.0, -9.81]])
def test_level_sheet_is_slow_upright_and_not_to_the_side(ratio, push):
    body = make_body(RehearsalOptions(points=30, spread=0.0), 0)
    term, masses = added_mass({"ratio": ratio}, body), np.full(len(body.vertices), 1e-3)
    velocities = np.zeros_like(body.vertices)
    for step in range(200):
        forces = masses[:, None] * np.array(push)
        term(state_of(body.vertices, velocities, masses, step), forces)
        velocities = velocities + STEP_S * forces / masses[:, None]
    expected = 200 * STEP_S * np.array(push) / [1.0, 1.0, 1.0 + ratio]
    assert velocities.mean(axis=0) == pytest.approx(expected, abs=0.04)


def test_solid_carries_none():
    body = make_body(RehearsalOptions(object=RehearsalObject.ELLIPSOID, points=30, spread=0.0), 0)
    term, masses = added_mass({"ratio": 1.0}, body), np.ones(len(body.vertices))
    forces = np.zeros_like(body.vertices)
    for step in range(3):
        term(state_of(body.vertices, step * np.ones_like(body.vertices), masses, step), forces)
    assert not forces.any()


def state_of(positions: np.ndarray, velocities: np.ndarray, masses: np.ndarray, step: int) -> StepState:
    return StepState(
        time=step * STEP_S,
        duration=STEP_S,
        positions=positions,
        velocities=velocities,
        masses=masses,
        pressures=np.zeros(len(masses)),
    )
