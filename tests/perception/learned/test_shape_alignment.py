"""Alignment of a known body, of which only the upper side is seen, against the place it was put."""

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.shape_alignment import align_shape
from egophys_core.perception.learned.similarity import Similarity


def ball(middle: tuple[float, float, float], radius: float, count: int) -> np.ndarray:
    """Points spread evenly over a sphere (golden spiral)."""
    index = np.arange(count) + 0.5
    polar, around = np.arccos(1 - 2 * index / count), np.pi * (1 + 5**0.5) * index
    return np.array(middle) + radius * np.stack(
        [np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1
    )


def toy() -> np.ndarray:
    """Body, head and one ear, lying: no turn about z puts it onto itself."""
    parts = [((0, 0, 0), 0.3), ((0.35, 0.05, 0.05), 0.17), ((0.42, 0.2, 0.15), 0.08)]
    points = []
    for number, (middle, radius) in enumerate(parts):
        surface = ball(middle, radius, int(6000 * radius))
        for other, (place, size) in enumerate(parts):
            if other != number:
                surface = surface[np.linalg.norm(surface - place, axis=1) > size]
        points.append(surface)
    return np.concatenate(points)


def put(yaw_degrees: float, scale: float) -> Similarity:
    yaw = np.radians(yaw_degrees)
    rotation = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return Similarity(scale=scale, rotation=rotation, translation=np.array([0.3, -0.2, 0.09]))


@pytest.mark.parametrize(("yaw", "scale"), [(0, 0.3), (77, 0.25), (171, 0.4), (-100, 0.3)])
def test_the_hidden_side_is_found_from_the_visible_one(yaw, scale):
    true = put(yaw, scale)
    shape = toy()
    placed = true.apply(shape)
    # Seen from above and in front; other samples of the same surface, with noise of 1.5 mm.
    other = true.apply(toy()[::2])
    visible = other[(other - other.mean(axis=0)) @ np.array([0.0, -0.5, 1.0]) > 0]
    visible = visible + np.random.default_rng(0).normal(0, 0.0015, visible.shape)
    found, distance = align_shape(shape, visible)
    error = np.linalg.norm(found.apply(shape) - placed, axis=1)
    assert found.scale == pytest.approx(true.scale, rel=0.03)
    assert error.mean() < 0.005
    assert distance < 0.004


def test_a_shape_that_was_generated_tilted_is_turned_back():
    true = put(40, 0.3)
    tilt = np.radians(12)
    tilted = toy() @ np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]).T
    placed = true.apply(toy())
    found, _ = align_shape(tilted, placed[placed[:, 2] > 0.08])
    assert np.linalg.norm(found.apply(tilted) - placed, axis=1).mean() < 0.005


def test_a_few_points_that_are_no_part_of_the_object_do_little_harm():
    true = put(20, 0.3)
    placed = true.apply(toy())
    visible = placed[placed[:, 2] > 0.08]
    stray = visible[:20] + [0.0, 0.0, 0.05]
    found, _ = align_shape(toy(), np.concatenate([visible, stray]))
    assert np.linalg.norm(found.apply(toy()) - placed, axis=1).mean() < 0.008


@pytest.mark.parametrize(
    ("shape", "visible", "message"),
    [
        (np.zeros((3, 3)), np.random.default_rng(0).normal(size=(9, 3)), "shape points must be"),
        (np.random.default_rng(0).normal(size=(9, 3)), np.full((9, 3), np.nan), "visible points must be"),
        (np.random.default_rng(0).normal(size=(9, 3)), np.ones((9, 3)), "all above each other"),
        (np.ones((9, 3)), np.random.default_rng(0).normal(size=(9, 3)), "all above each other"),
    ],
)
def test_what_cannot_be_aligned_is_refused(shape, visible, message):
    with pytest.raises(EpisodeError, match=message):
        align_shape(shape, visible)
