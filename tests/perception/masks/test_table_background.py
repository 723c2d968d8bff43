"""The plane's homography against the projection of points, and the likelihood of table against equations."""

import numpy as np
import pytest

from egophys_core.perception.masks.colour_model import UNIFORM, ColourModel, colour_codes, feature_step, log_features
from egophys_core.perception.masks.table_background import (
    TableBackground,
    table_homography,
    table_log_likelihood,
    table_places,
)
from tests.perception.table_scene import Scene, camera_pose, draw, project


def test_homography_projects_points_of_the_table_and_back():
    view, _ = draw(Scene(), 7)
    places = np.array([[0.1, 0.05], [-0.2, 0.1], [0.0, -0.1]])
    pixels = project(np.column_stack([places, np.full(3, 0.02)]), camera_pose(7))
    mapped = np.column_stack([places, np.ones(3)]) @ table_homography(view, 0.02).T
    assert mapped[:, :2] / mapped[:, 2:] == pytest.approx(pixels)
    assert table_places(view, pixels, 0.02) == pytest.approx(places)


def test_ray_above_the_horizon_meets_no_table():
    view, _ = draw(Scene(), 0)
    assert np.isnan(table_places(view, np.array([[259.0, -2000.0]]))).all()


def test_empty_table_is_expected_where_it_was_seen():
    scene = Scene(hand_frames=None, noise=0.0)
    view, truth = draw(scene, 0)
    background = TableBackground(view, np.zeros(2), log_features(view.image), ~truth.object)
    later, masks = draw(scene, 10)
    expected = background.expected(later)
    off = np.abs(log_features(later.image) - expected.mean).max(axis=-1)
    assert np.median(off[expected.seen & ~masks.object]) < 0.03
    assert np.count_nonzero(expected.seen & masks.object) < 0.1 * np.count_nonzero(masks.object)
    # Under the object the table is guessed from around it.
    under = np.abs(expected.mean[masks.object] - np.median(expected.mean[expected.seen], axis=0))
    assert np.median(under) < 0.1


def test_table_is_likelier_lit_as_learnt_and_in_shadow_than_of_another_hue():
    mean = np.tile(np.array([0.3, -0.2, 5.0], np.float32), (1, 4, 1))
    variance = np.full((1, 4, 3), 0.05**2, np.float32)
    seen = mean.copy()
    seen[0, 1, 2] -= np.log(2)
    seen[0, 2, 0] += 0.3
    seen[0, 3, 2] += np.log(2)
    same, other = table_log_likelihood(seen, mean, variance)
    # A Gaussian at its mean, over the volume of a bin.
    assert same[0, 0] == pytest.approx(np.log(feature_step() / (np.sqrt(2 * np.pi) * 0.05)).sum(), rel=1e-4)
    assert same[0, 0] > other[0, 0]
    assert other[0, 1] > same[0, 1]
    assert other[0, 1] > other[0, 3] > UNIFORM
    assert max(same[0, 2], other[0, 2]) < UNIFORM


def test_colours_learnt_are_likelier_and_shade_is_expected():
    model = ColourModel(shading=0.3, background_share=0.02)
    image = np.array([[[60, 180, 70], [30, 90, 35], [200, 40, 60]]], np.uint8)
    codes = colour_codes(image)[0]
    assert not model.known
    assert model.log_likelihood(codes) == pytest.approx(np.full(3, UNIFORM), abs=1e-4)
    model.learn(codes[:1].repeat(50))
    lit, shaded, foreign = model.log_likelihood(codes)
    assert lit > shaded > foreign
    assert foreign == pytest.approx(UNIFORM + np.log(0.02), abs=0.05)
