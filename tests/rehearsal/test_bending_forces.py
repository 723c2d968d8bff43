"""Injected damping of bending: it acts on bending only, and takes energy."""

import numpy as np
import pytest

from egophys_core.errors import OptionsError
from egophys_core.rehearsal import RehearsalOptions
from egophys_core.rehearsal.bending_forces import bending_damping
from egophys_core.rehearsal.bodies import make_body
from tests.rehearsal.steps import force_of, step_state


@pytest.fixture(scope="module")
def sheet():
    return make_body(RehearsalOptions(points=3), 0)


@pytest.fixture(scope="module")
def bent(sheet):
    """The sheet on a cylinder around the y axis."""
    x, y, _ = sheet.vertices.T
    return np.stack([0.2 * np.sin(x / 0.2), y, 0.2 * np.cos(x / 0.2)], axis=1)


def test_rigid_motion_is_free(sheet, bent):
    spin = np.cross([0.3, -1.0, 2.0], bent) + [1.0, 2.0, 3.0]
    force = force_of(bending_damping({"factor": 50.0}, sheet), step_state(bent, velocities=spin))
    np.testing.assert_allclose(force, 0.0, atol=1e-7)


def test_stretching_a_flat_sheet_is_free(sheet):
    state = step_state(sheet.vertices, velocities=sheet.vertices * [1.0, -0.5, 0.0])
    np.testing.assert_allclose(force_of(bending_damping({"factor": 50.0}, sheet), state), 0.0, atol=1e-9)


def test_power_of_bending_is_that_of_a_plate(sheet):
    """v = x^2 / 2 bends at 1 / (m s): a plate loses 49 material times times D per area; a mesh errs at its rim."""
    x = sheet.vertices[:, 0]
    velocities = np.stack([np.zeros_like(x), np.zeros_like(x), 0.5 * x**2], axis=1)
    # So short a step that the velocity after it is that before it.
    state = step_state(sheet.vertices, velocities=velocities, duration=1e-7)
    power = -np.sum(force_of(bending_damping({"factor": 50.0}, sheet), state) * velocities)
    stiffness = sheet.young * sheet.thickness**3 / (12.0 * (1.0 - sheet.poisson**2))
    area = np.prod(np.ptp(sheet.vertices, axis=0)[:2])
    assert power == pytest.approx(49.0 * sheet.damping * stiffness * area, rel=0.1)


def test_forces_are_internal(sheet, bent):
    velocities = np.random.default_rng(0).normal(size=bent.shape)
    force = force_of(bending_damping({"factor": 50.0}, sheet), step_state(bent, velocities=velocities))
    scale = np.abs(force).max()
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-9 * scale)
    np.testing.assert_allclose(np.cross(bent, force).sum(axis=0), 0.0, atol=1e-9 * scale)
    assert np.sum(force * velocities) < 0.0


def test_less_damping_than_the_material_has_is_refused(sheet):
    with pytest.raises(OptionsError, match=r"factor must be 1 or more, got 0\.5"):
        bending_damping({"factor": 0.5}, sheet)
