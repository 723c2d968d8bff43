"""Where a twin's nodes are now: of a sheet that was moved, bent about a cylinder or folded, as its points show it."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.observation import SeenObject, present_nodes, require_at_rest, with_new_points
from tests.simulation.scenes import sheet_model
from tests.twin.examples import make_twin

LONG, WIDE, SPACING, HEIGHT, RADIUS = 13, 8, 0.02, 0.005, 0.07
"""A sheet of 24 cm by 14 cm, and the cylinder that half of it is bent about."""
RANDOM = np.random.default_rng(3)
MATERIAL = RANDOM.uniform((0, 0), ((LONG - 1) * SPACING, (WIDE - 1) * SPACING), (300, 2))
"""[P, 2] metres: where on the sheet the points are."""
IDS = np.arange(100, 400, dtype=np.uint32)


def flat(material):
    return np.column_stack([material, np.full(len(material), HEIGHT)])


def bent(material):
    """Beyond half its length the sheet goes up and back about a cylinder, as paper does: no length changes."""
    x, y = material.T
    begins = 0.5 * (LONG - 1) * SPACING
    angle = np.clip(x - begins, 0, None) / RADIUS
    return np.column_stack([np.minimum(x, begins) + RADIUS * np.sin(angle), y, HEIGHT + RADIUS * (1 - np.cos(angle))])


def folded(material):
    """One half on the other."""
    x, y = material.T
    middle = 0.5 * (LONG - 1) * SPACING
    return np.column_stack([middle - np.abs(x - middle), y, np.where(x > middle, HEIGHT + 0.006, HEIGHT)])


def moved(points):
    """Turned by 50 degrees about the vertical, and shifted."""
    cosine, sine = np.cos(np.deg2rad(50)), np.sin(np.deg2rad(50))
    return points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) + [0.1, -0.2, 0.0]


def noisy(points, seed=0):
    return (points + np.random.default_rng(seed).normal(0, 0.001, points.shape)).astype(np.float32)


def seen(points, ids=IDS, bound=None):
    return SeenObject(ids=ids, points=points, bound=bound)


def grid():
    x, y = np.meshgrid(np.arange(LONG) * SPACING, np.arange(WIDE) * SPACING, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.fixture(scope="module")
def twin():
    return make_twin(sheet_model(flat(grid()).astype(np.float32), radius=1.5 * SPACING))


@pytest.fixture(scope="module")
def bound(twin):
    """All points known, from the sheet as it lies."""
    return with_new_points(twin, seen(noisy(flat(MATERIAL))))


def errors(nodes, where):
    """[N] metres: how far nodes are from where they truly are."""
    return np.linalg.norm(nodes - where(grid()), axis=1)


@pytest.mark.parametrize(
    "where", [bent, folded, lambda material: moved(bent(material))], ids=["bent", "folded", "both"]
)
def test_a_deformed_sheet_is_found_from_half_of_its_points(twin, bound, where):
    half, other = np.split(RANDOM.permutation(300), 2)
    half.sort()
    nodes = present_nodes(twin, seen(noisy(where(MATERIAL), seed=1)[half], IDS[half], bound))
    at_others = np.linalg.norm(bound.weights[other] @ nodes - where(MATERIAL)[other], axis=1)
    # The noise of a point is 1 mm along each axis; at the fold the sheet bends more sharply than nodes are dense.
    assert np.median(at_others) < 0.0025
    assert np.quantile(at_others, 0.9) < 0.006
    # Which of its material a node is depends on where the sheet was found to lie when its points were bound.
    assert np.median(errors(nodes, where)) < 0.006
    assert nodes[:, 2].min() >= HEIGHT - 0.001


def test_points_that_are_far_off_do_not_bend_the_sheet(twin, bound):
    points = noisy(bent(MATERIAL), seed=2)
    points[::15] += np.float32([0.05, -0.05, 0.08])
    assert np.median(errors(present_nodes(twin, seen(points, bound=bound)), bent)) < 0.006


def test_what_is_hidden_is_carried_along(twin, bound):
    shown = MATERIAL[:, 1] > 0.05
    nodes = present_nodes(twin, seen(noisy(bent(MATERIAL))[shown], IDS[shown], bound))
    assert errors(nodes, bent)[grid()[:, 1] < 0.03].max() < 0.02


def test_a_sheet_that_lies_elsewhere_is_found_without_its_ids(twin):
    points = noisy(moved(flat(MATERIAL)))
    nodes = present_nodes(twin, seen(points, IDS + 1000))
    assert errors(nodes, lambda each: moved(flat(each))).max() < 0.006


@pytest.mark.parametrize("where", [bent, folded])
def test_a_deformed_sheet_without_known_points_is_refused(twin, bound, where):
    points = noisy(where(MATERIAL))
    assert with_new_points(twin, seen(points)) is None
    for known in (None, bound):
        with pytest.raises(EpisodeError, match=r"is not in the shape that twin \w+ has at rest.*Lay it down"):
            present_nodes(twin, seen(points, IDS + 1000, known))


def test_known_ids_on_other_points_are_noticed(twin, bound):
    mixed = noisy(bent(MATERIAL))[RANDOM.permutation(300)]
    with pytest.raises(EpisodeError, match="not known by their ids"):
        present_nodes(twin, seen(mixed, bound=bound))
    # Laid down again, the points are bound anew: the shape itself tells.
    again = with_new_points(twin, seen(noisy(flat(MATERIAL)), IDS + 1000, bound))
    assert again.ids.tolist() == (IDS + 1000).tolist()


def test_points_that_appear_later_are_known_while_the_sheet_lies_there(twin):
    first = with_new_points(twin, seen(noisy(flat(MATERIAL))[50:], IDS[50:]))
    whole = with_new_points(twin, seen(noisy(flat(MATERIAL), seed=1), bound=first))
    assert whole.ids.tolist() == IDS.tolist()
    there = whole.weights @ bent(grid())
    assert np.quantile(np.linalg.norm(there - bent(MATERIAL), axis=1), 0.9) < 0.006
    assert with_new_points(twin, seen(noisy(bent(MATERIAL)), bound=first)) is first


def test_too_few_points_and_points_that_move_are_refused(twin, bound):
    with pytest.raises(EpisodeError, match="only 19 points of the object are seen, 20 are needed"):
        present_nodes(twin, seen(noisy(flat(MATERIAL))[:19], IDS[:19], bound))
    before, now = seen(noisy(flat(MATERIAL))), seen(noisy(flat(MATERIAL), seed=1))
    require_at_rest(before, now)
    with pytest.raises(EpisodeError, match="the object moves, by 20 mm"):
        require_at_rest(before, replace(now, points=now.points + np.float32([0.02, 0, 0])))
