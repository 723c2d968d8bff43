"""Injected forces through space against their equations."""

import numpy as np
import pytest

from egophys_core.rehearsal import field_forces
from tests.rehearsal.steps import force_of, step_state

PLACES = [[0.0, 0.0, 0.0], [0.3, -0.2, 0.1]]
MASSES = [0.5, 2.0]


def test_drag_is_quadratic_against_the_velocity():
    state = step_state(PLACES, velocities=[[3.0, 4.0, 0.0], [0.0, 0.0, -1.0]], masses=MASSES)
    force = force_of(field_forces.quadratic_drag({"coefficient": 2.0}), state)
    np.testing.assert_allclose(force, [[-15.0, -20.0, 0.0], [0.0, 0.0, 4.0]])


def test_constant_force_goes_with_mass():
    force = force_of(
        field_forces.constant_body_force({"x": 1.0, "y": 0.0, "z": -2.0}), step_state(PLACES, masses=MASSES)
    )
    np.testing.assert_allclose(force, [[0.5, 0.0, -1.0], [2.0, 0.0, -4.0]])


@pytest.mark.parametrize(("time", "share"), [(0.5, 0.0), (1.0, 0.0), (1.125, 1.0), (1.375, -1.0), (1.625, 0.0)])
def test_varying_force_acts_from_its_onset_for_its_duration(time, share):
    values = {"x": 3.0, "y": 0.0, "z": 0.0, "onset": 1.0, "duration": 0.6, "frequency": 2.0, "phase": 0.5 * np.pi}
    term = field_forces.time_varying_body_force(values)
    force = force_of(term, step_state(PLACES, time=time))
    np.testing.assert_allclose(force[:, 0], 3.0 * share, atol=1e-12)


def test_attraction_is_the_slope_of_a_well():
    values = {"x": 0.1, "y": 0.2, "z": 0.3, "strength": 4.0, "range": 0.2}
    point = np.array([0.1, 0.2, 0.3])

    def energy(place):
        return -4.0 * 0.2 * np.exp(0.5 - np.sum((place - point) ** 2) / (2 * 0.2**2))

    place, h = np.array([0.25, 0.1, 0.2]), 1e-5
    slope = [(energy(place + h * axis) - energy(place - h * axis)) / (2 * h) for axis in np.eye(3)]
    force = force_of(field_forces.point_attraction(values), step_state([place], masses=[2.0]))
    np.testing.assert_allclose(force[0], -2.0 * np.array(slope), rtol=1e-6)
    assert force_of(field_forces.point_attraction(values), step_state([point])) == pytest.approx(0.0)


def test_attraction_is_strongest_at_its_range():
    values = {"x": 0.1, "y": 0.2, "z": 0.3, "strength": 4.0, "range": 0.2}
    force = force_of(field_forces.point_attraction(values), step_state([[0.3, 0.2, 0.3]], masses=[2.0]))
    np.testing.assert_allclose(force, [[-8.0, 0.0, 0.0]], atol=1e-12)


def test_tether_pulls_its_place_when_taut_only():
    values = {"x": 0.0, "y": 0.0, "z": 0.1, "anchor_x": 0.0, "anchor_y": 0.5, "stiffness": 4.0, "length": 0.3}
    resting = np.array([[0.0, 0.0, 0.1], [0.3, -0.2, 0.1]])
    term = field_forces.hidden_tether(values, resting)
    # 4 1/s^2 of the 2.5 kg of the whole body, stretched by 0.2 m.
    np.testing.assert_allclose(force_of(term, step_state(resting, masses=MASSES)), [[0.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    assert not force_of(term, step_state([[0.0, 0.25, 0.1], resting[1]], masses=MASSES)).any()
