"""Friction that differs from place to place and with speed, against Coulomb's law."""

import numpy as np
import pytest

from tests.effects.situations import G, accelerations, centre_path, run, sheet, solid, with_effect

MU = 0.3


def slid(model, *, velocity=(0.0, 0.0, 0.0), duration=1.0):
    """How far an object on the table comes, metres."""
    path = centre_path(run(model, duration=duration, ground_height=0.0, velocity=velocity))
    return float(path[-1, 0] - path[0, 0])


def slider():
    return sheet(friction=MU, drag=0.0)


@pytest.mark.parametrize("change", [-0.6, 0.0, 1.5])
def test_on_a_patch_an_object_slides_as_far_as_its_friction_lets_it(change):
    # v^2 / (2 mu (1 + change) g)
    patch = {"x": 0.0, "y": 0.0, "radius": 1.0, "change": change}
    model = with_effect(slider(), "place_dependent_friction", **patch)
    assert slid(model, velocity=(0.8, 0, 0)) == pytest.approx(0.8**2 / (2 * MU * (1 + change) * G), rel=0.02)


def test_beside_the_patch_nothing_changes():
    patch = {"x": -0.5, "y": 0.0, "radius": 0.2, "change": 3.0}
    model = with_effect(slider(), "place_dependent_friction", **patch)
    assert slid(model, velocity=(0.8, 0, 0)) == pytest.approx(slid(slider(), velocity=(0.8, 0, 0)), abs=1e-6)


def test_a_node_above_the_patch_feels_nothing():
    patch = {"x": 0.0, "y": 0.0, "radius": 0.2, "change": 2.0}
    pressed = accelerations("place_dependent_friction", patch, [[0, 0, 0], [0, 0, 0.02], [0.5, 0, 0]])
    assert pressed[0, 2] < -G
    assert (pressed[1:] == 0).all()


@pytest.mark.parametrize(("pull", "slides"), [(0.5, False), (1.3, False), (1.7, True)])
def test_stribeck_friction_sticks_up_to_its_larger_coefficient(pull, slides):
    # Coulomb friction alone would let go at mu g; with the rise of 0.5 it holds up to 1.5 mu g.
    model = with_effect(slider(), "constant_body_force", x=pull * MU * G, y=0.0, z=0.0)
    model = with_effect(model, "stribeck_friction", rise=0.5, speed=0.1)
    assert (slid(model) > 0.1) == slides
    assert slides or slid(model) < 1e-3


def test_stribeck_friction_is_coulomb_friction_at_speed():
    moving = np.array([[0.5, 0, 0], [0.0, 0.1, 0]])
    pressed = accelerations("stribeck_friction", {"rise": 2.0, "speed": 0.1}, np.zeros((2, 3)), velocities=moving)[:, 2]
    assert pressed[0] == pytest.approx(0.0, abs=1e-6)
    assert pressed[1] == pytest.approx(-2.0 * G / np.e, rel=1e-5)


def test_nodes_under_a_solid_bear_those_above():
    model = solid(friction=MU, drag=0.0, stiffness=100.0, damping=0.05)
    patch = {"x": 0.0, "y": 0.0, "radius": 1.0, "change": 1.0}
    rougher = with_effect(model, "place_dependent_friction", **patch)
    # A third of the nodes touch the table: without their share in what is above, friction would rise by a third.
    assert slid(rougher, velocity=(0.5, 0, 0)) == pytest.approx(slid(model, velocity=(0.5, 0, 0)) / 2, rel=0.15)
