"""A body whose stiffness differs from place to place."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.rehearsal import Motion, RehearsalObject, RehearsalOptions, rehearse_body
from egophys_core.rehearsal.bodies import make_body
from egophys_core.rehearsal.engine import FlexEngine
from egophys_core.rehearsal.meshes import boundary, box_mesh

LOAD = 0.003
"""Of the modulus."""


def sheet():
    return make_body(RehearsalOptions(points=3, spread=0.0), 0)


def box():
    vertices, elements = box_mesh(np.array([0.32, 0.06, 0.06]))
    of_box = make_body(RehearsalOptions(object=RehearsalObject.BOX, points=3, spread=0.0), 0)
    vertices[:, 2] += 0.1
    return replace(
        of_box,
        vertices=vertices,
        elements=elements,
        surface=boundary(elements),
        stiffness_shares=np.ones(len(elements)),
        young=5e3,
    )


def strains(body, left, right):
    """Along a body that is pulled at both ends, in its left and in its right half, away from ends and middle."""
    on_left = body.vertices[body.elements, 0].mean(axis=1) < 0.0
    body = replace(body, young=0.5 * body.young, stiffness_shares=np.where(on_left, left, right))
    engine = FlexEngine(body, step=4e-4, pressing=0, folding=False)
    engine.set_gravity(np.zeros(3))
    engine.set_damping(20.0)
    x = body.vertices[:, 0]
    width, height = np.ptp(body.vertices, axis=0)[1:]
    pull = LOAD * body.young * width * (body.thickness if body.is_sheet else height)
    for end, sign in ((x < x.min() + 0.01, -1.0), (x > x.max() - 0.01, 1.0)):
        engine.forces[end, 0] = sign * pull / end.sum()
    for _ in range(1500):
        engine.step()
    moved = engine.positions[:, 0] - x
    halves = [(sign * x > 0.02) & (sign * x < x.max() - 0.03) for sign in (-1.0, 1.0)]
    return np.array([np.polyfit(x[half], moved[half], 1)[0] for half in halves])


@pytest.mark.parametrize("make", [sheet, box])
def test_parts_one_behind_the_other_stretch_by_their_own_compliance(make):
    """Springs in series: the same tension in both halves, strain = tension / (E A share)."""
    same = strains(make(), 1.0, 1.0)
    np.testing.assert_allclose(strains(make(), 0.7, 2.8) * [0.7, 2.8], same, rtol=0.06)


def test_a_box_stretches_by_its_modulus():
    np.testing.assert_allclose(strains(box(), 1.0, 1.0), LOAD, rtol=0.1)


@pytest.mark.parametrize("make", [sheet, box])
def test_twice_the_share_is_twice_the_modulus(make):
    """In stretching and in bending: the body is bent by forces up in its middle and down at its ends."""
    body = replace(make(), young=1e4)
    positions = []
    for each in (
        replace(body, young=2.0 * body.young, damping=0.5 * body.damping),
        replace(body, stiffness_shares=np.full(len(body.elements), 2.0), damping=0.5 * body.damping),
    ):
        engine = FlexEngine(each, step=4e-4, pressing=0, folding=False)
        engine.set_gravity(np.zeros(3))
        engine.forces[:, 2] = 5.0 * body.mass / len(body.vertices) * np.cos(10.0 * body.vertices[:, 0])
        for _ in range(300):
            engine.step()
        positions.append(engine.positions)
    np.testing.assert_allclose(*positions, atol=1e-6)
    assert np.abs(positions[0] - body.vertices).max() > 1e-2


def test_a_given_body_is_rehearsed_as_it_is():
    options = RehearsalOptions(object=RehearsalObject.BOX, duration_s=0.1, points=9)
    episode = rehearse_body(sheet(), options, Motion.LIFT, name="given", seeds=(0, 0))
    assert episode.name == "given"
    assert episode.points.shape == (3, 3, 3)
    assert np.nanmax(episode.points[..., 2]) < 0.02
