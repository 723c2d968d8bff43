"""The soft objects: meshes without holes, points on them, the same for the same seed."""

from dataclasses import fields

import numpy as np
import pytest

from egophys_core.errors import OptionsError
from egophys_core.rehearsal import RehearsalObject, RehearsalOptions
from egophys_core.rehearsal.bodies import SKIN, make_body
from egophys_core.rehearsal.meshes import SEAT

SOLIDS = (RehearsalObject.ELLIPSOID, RehearsalObject.BOX)


@pytest.mark.parametrize("kind", RehearsalObject)
def test_object_is_its_seed(kind):
    options = RehearsalOptions(object=kind, points=20)
    first, again, other = (make_body(options, seed) for seed in (3, 3, 4))
    for field in fields(first):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(again, field.name))
    assert first.mass != other.mass
    assert first.young != other.young


@pytest.mark.parametrize("kind", RehearsalObject)
def test_it_stands_on_the_table(kind):
    body = make_body(RehearsalOptions(object=kind, points=20), 0)
    assert body.vertices[:, 2].min() == pytest.approx(SKIN)
    assert np.unique(body.elements).tolist() == list(range(len(body.vertices)))


@pytest.mark.parametrize("kind", SOLIDS)
def test_solids_are_filled(kind):
    body = make_body(RehearsalOptions(object=kind, points=3), 0)
    corners = body.vertices[body.elements]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert (volumes > 0).all()
    x, y, z = np.ptp(body.vertices, axis=0)
    # Cut at SEAT of the radius: the volume of a unit ball below z = -s is pi (2/3 - s + s^3 / 3).
    ball = 4 / 3 - (2 / 3 - SEAT + SEAT**3 / 3)
    full = x * y * z if kind is RehearsalObject.BOX else np.pi * ball * x * y * z / (4 * (1 + SEAT))
    # The facets of a coarse ball are inside it.
    assert 0.85 * full < volumes.sum() <= 1.0001 * full


@pytest.mark.parametrize("kind", SOLIDS)
def test_surface_is_closed(kind):
    body = make_body(RehearsalOptions(object=kind, points=3), 0)
    sides = np.sort(np.concatenate([body.surface[:, list(pair)] for pair in ((0, 1), (1, 2), (0, 2))]), axis=1)
    assert (np.unique(sides, axis=0, return_counts=True)[1] == 2).all()


def test_tracked_points_cover_the_surface_evenly():
    body = make_body(RehearsalOptions(points=100), 0)
    points = body.tracked(body.vertices)
    gaps = np.linalg.norm(points[:, None] - points, axis=2) + np.eye(100)
    area = np.prod(np.ptp(body.vertices, axis=0)[:2])
    assert gaps.min(axis=1).min() > 0.5 * np.sqrt(area / 100)
    moved = body.tracked(np.stack([body.vertices, 2.0 * body.vertices]))
    np.testing.assert_allclose(moved, [points, 2.0 * points])


def test_no_spread_no_difference():
    bodies = [make_body(RehearsalOptions(points=3, spread=0.0), seed) for seed in (1, 2)]
    assert bodies[0].young == bodies[1].young == 4e4
    np.testing.assert_array_equal(bodies[0].vertices, bodies[1].vertices)


def test_options_out_of_range_are_refused():
    with pytest.raises(OptionsError, match=r"noise_m must be in 0 \.\. 0\.05, got 1\.5"):
        RehearsalOptions(noise_m=1.5)
