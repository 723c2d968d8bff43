"""Injected forces at the table against their equations."""

import numpy as np
import pytest

from egophys_core.rehearsal import table_forces
from egophys_core.rehearsal.bodies import SKIN
from tests.rehearsal.steps import force_of, step_state


def slide(term, *, speed, pressure=2.0, steps=2000):
    """The force along x on a vertex that the hand moves at a speed, after some millimetres."""
    for step in range(steps):
        place = [1e-3 * speed * step, 0.0, SKIN]
        force = force_of(term, step_state([place], velocities=[[speed, 0.0, 0.0]], pressures=[pressure]))
    return force[0]


def test_adhesion_is_strongest_at_its_reach_and_gone_far_above():
    term = table_forces.table_adhesion({"strength": 3.0, "reach": 0.002}, np.array([0.01]))
    pulls = [
        force_of(term, step_state([[0.0, 0.0, SKIN + h]], masses=[0.1]))[0, 2]
        for h in (-1e-3, 0.0, 1e-3, 2e-3, 4e-3, 0.1)
    ]
    assert pulls[0] == pulls[1] == 0.0
    assert pulls[3] == pytest.approx(-0.3)
    assert pulls[3] < pulls[2] < 0.0
    assert pulls[3] < pulls[4] < pulls[5] == pytest.approx(0.0)


@pytest.mark.parametrize(("change", "there", "elsewhere"), [(2.0, 0.8, 0.0), (-0.75, 0.0, 0.3)])
def test_friction_depends_on_place(change, there, elsewhere):
    """The engine keeps the smaller of the two frictions; what is added is the difference times the pressure."""
    for centre, extra in ((0.0, there), (5.0, elsewhere)):
        values = {"x": centre, "y": 0.0, "radius": 1.0, "change": change}
        force = slide(table_forces.place_dependent_friction(values, 0.4), speed=0.01)
        np.testing.assert_allclose(force, [-2.0 * extra, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("speed", [0.01, 0.05, 0.2])
def test_stribeck_friction_falls_with_speed(speed):
    force = slide(table_forces.stribeck_friction({"rise": 1.5, "speed": 0.05}, 0.4), speed=speed)
    assert force[0] == pytest.approx(-2.0 * 0.4 * 1.5 * np.exp(-((speed / 0.05) ** 2)), abs=1e-9)


def test_friction_sticks_below_its_limit_and_needs_pressure():
    term = table_forces.stribeck_friction({"rise": 1.0, "speed": 1.0}, 0.5)
    force_of(term, step_state([[0.0, 0.0, SKIN]], pressures=[2.0]))
    pulled = force_of(term, step_state([[5e-6, 0.0, SKIN]], pressures=[2.0]))
    assert pulled[0, 0] == pytest.approx(-5e-6 * table_forces.BRISTLE_FREQUENCY**2)
    assert not force_of(term, step_state([[0.01, 0.0, 0.1]], pressures=[0.0])).any()
