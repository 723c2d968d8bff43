"""The objects of the prior's set: whole meshes, stiffness that varies as said, a material that the engine follows."""

from dataclasses import fields

import numpy as np
import pytest

from benchmarks.prior.objects import (
    FAMILIES,
    LARGEST_SPECIFIC_STIFFNESS,
    LARGEST_VISCOSITY,
    Shape,
    made_uniform,
    make_object,
)
from benchmarks.prior.sequences import SEQUENCES
from benchmarks.prior.variations import FIELDS, Parts, Variation
from egophys_core.kinds.rest_shape import recognised
from egophys_core.rehearsal.bodies import SKIN
from egophys_core.rehearsal.hands import CONTACT_BEGINS, write_script

OBJECTS = {each.object_seed: (each.shape, each.variation) for each in SEQUENCES}


@pytest.fixture(scope="module")
def bodies():
    """The objects of the set, by seed."""
    return {seed: make_object(*which, seed, points=60) for seed, which in OBJECTS.items()}


def parts_of(body):
    return Parts(vertices=body.vertices, elements=body.elements)


@pytest.mark.parametrize("shape", Shape)
def test_object_is_its_seed(shape):
    first, again, other = (make_object(shape, Variation.STUFFING, seed, points=5) for seed in (3, 3, 4))
    for field in fields(first):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(again, field.name))
    assert first.young != other.young
    assert first.mass != other.mass


def test_meshes_are_whole_and_stand_on_the_table(bodies):
    for body in bodies.values():
        assert body.vertices[:, 2].min() == pytest.approx(SKIN)
        assert np.unique(body.elements).tolist() == list(range(len(body.vertices)))
        together = np.zeros(len(body.vertices), bool)
        together[0] = True
        for _ in range(100):
            together[body.elements[together[body.elements].any(axis=1)]] = True
        assert together.all()
        if not body.is_sheet:
            corners = body.vertices[body.elements]
            assert (np.linalg.det(corners[:, 1:] - corners[:, :1]) > 0.0).all()


def test_each_is_recognised_as_what_it_is(bodies):
    for seed, body in bodies.items():
        kind = recognised(body.tracked(body.vertices))
        assert kind.lies_flat == FAMILIES[OBJECTS[seed][0]].is_sheet


def test_the_engine_can_follow_the_stiffest_place(bodies):
    for body in bodies.values():
        volume = parts_of(body).volumes.sum() * (body.thickness if body.is_sheet else 1.0)
        peak = body.young * body.stiffness_shares.max() * volume / body.mass
        assert peak <= 1.0001 * LARGEST_SPECIFIC_STIFFNESS[body.is_sheet]
        assert peak * body.damping <= 1.0001 * LARGEST_VISCOSITY[body.is_sheet]


def test_stiffness_is_the_mean_by_volume(bodies):
    for seed, body in bodies.items():
        assert np.average(body.stiffness_shares, weights=parts_of(body).volumes) == pytest.approx(1.0)
        assert (np.ptp(body.stiffness_shares) > 0.5) == (OBJECTS[seed][1] is not Variation.UNIFORM)
        assert (made_uniform(body).stiffness_shares == 1.0).all()


@pytest.mark.parametrize(
    ("shape", "variation"),
    [
        *((Shape.TOWEL, each) for each in FIELDS if each is not Variation.SKIN),
        *((Shape.BAG, each) for each in FIELDS if each is not Variation.HEM),
    ],
)
def test_factors_stay_in_their_range(shape, variation):
    for seed in range(5):
        parts = parts_of(make_object(shape, Variation.UNIFORM, seed, points=3))
        factors = FIELDS[variation](parts, np.random.default_rng(seed))
        assert factors.shape == (len(parts.elements),)
        assert factors.min() >= 0.25
        assert factors.max() <= 6.0
        assert variation is Variation.UNIFORM or factors.max() > 3.0 * factors.min()


def test_a_hem_is_at_the_rim_and_a_skin_outside():
    towel = make_object(Shape.TOWEL, Variation.HEM, 0, points=3)
    at_rim = np.abs(parts_of(towel).relative[:, :2]).max(axis=1)
    stiff = towel.stiffness_shares > 1.0
    assert at_rim[stiff].min() > 0.75
    assert at_rim[~stiff].max() < 0.97
    bag = make_object(Shape.BAG, Variation.SKIN, 0, points=3)
    deep = np.isin(bag.elements, np.unique(bag.surface), invert=True).sum(axis=1) >= 2
    assert deep.any()
    assert (bag.stiffness_shares[deep] < 1.0).all()


def test_hands_reach_every_object(bodies):
    for sequence in SEQUENCES:
        body = bodies[sequence.object_seed]
        script = write_script(sequence.motion, body, body.vertices, np.random.default_rng(sequence.seed))
        gaps = np.linalg.norm(script.at(CONTACT_BEGINS).centres[:, None] - body.vertices, axis=2).min(axis=1)
        assert (gaps < 0.03).all() if np.isfinite(script.closes) else (gaps > 0.025).all()
