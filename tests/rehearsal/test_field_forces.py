"""Planted forces through space against their equations."""

import numpy as np
import pytest

from egophys_core.rehearsal import field_forces
from tests.rehearsal.steps import force_of, step_state

PLACES = [[0.0, 0.0, 0.0], [0.3, -0.2, 0.1]]
MASSES = [0.5, 2.0]


def test_drag_is_quadratic_against_the_velocity():
    state = step_state(PLACES, velocities=[[3.0, 4.0, 0.0], [0.0, 0.0, -1.0]], masses=MASSES)
    force = force_of(field_forces.quadratic_drag({"c_per_kg": 2.0}), state)
    np.testing.assert_allclose(force, [[-15.0, -20.0, 0.0], [0.0, 0.0, 4.0]])


def test_constant_force_goes_with_mass():
    force = force_of(
        field_forces.constant_body_force({"ax": 1.0, "ay": 0.0, "az": -2.0}), step_state(PLACES, masses=MASSES)
    )
    np.testing.assert_allclose(force, [[0.5, 0.0, -1.0], [2.0, 0.0, -4.0]])


@pytest.mark.parametrize(("time", "share"), [(0.5, 0.0), (1.0, 0.0), (1.125, 1.0), (1.375, -1.0)])
def test_varying_force_begins_at_its_onset(time, share):
    term = field_forces.time_varying_body_force({"ax": 3.0, "ay": 0.0, "az": 0.0, "frequency": 2.0, "onset": 1.0})
    force = force_of(term, step_state(PLACES, time=time))
    np.testing.assert_allclose(force[:, 0], 3.0 * share, atol=1e-12)


def test_attraction_is_the_slope_of_a_well():
    values = {"x": 0.1, "y": 0.2, "z": 0.3, "strength": 4.0, "range": 0.2}
    point = np.array([0.1, 0.2, 0.3])

    def energy(place):
        return -4.0 * 0.2 * np.exp(-np.sum((place - point) ** 2) / (2 * 0.2**2))

    place, h = np.array([0.25, 0.1, 0.2]), 1e-5
    slope = [(energy(place + h * axis) - energy(place - h * axis)) / (2 * h) for axis in np.eye(3)]
    force = force_of(field_forces.point_attraction(values), step_state([place], masses=[2.0]))
    np.testing.assert_allclose(force[0], -2.0 * np.array(slope), rtol=1e-6)
    assert force_of(field_forces.point_attraction(values), step_state([point])) == pytest.approx(0.0)


def test_tether_pulls_its_place_when_taut_only():
    values = {"px": 0.0, "py": 0.0, "pz": 0.0, "ax": 0.0, "ay": 0.0, "az": 0.5, "stiffness": 10.0, "length": 0.3}
    term = field_forces.hidden_tether(values, np.array(PLACES))
    np.testing.assert_allclose(force_of(term, step_state(PLACES)), [[0.0, 0.0, 2.0], [0.0, 0.0, 0.0]])
    assert not force_of(term, step_state([[0.0, 0.0, 0.25], PLACES[1]])).any()
