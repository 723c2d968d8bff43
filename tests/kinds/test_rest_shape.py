"""The object at rest: nodes, kind, filling; and where another episode has it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

from egophys_core.effects.rotations import rotation
from egophys_core.errors import EpisodeError
from egophys_core.geometry import farthest_points
from egophys_core.kinds.rest_shape import rest_shape
from egophys_core.kinds.solid import SEARCHED, model_of
from egophys_core.observation.at_rest import observed_at_rest, still_frames
from egophys_core.observation.contact import see_hands
from egophys_core.observation.registration import place, placed
from egophys_core.simulation import batch_of_models, rollout
from tests.identification.synthetic import episode_of, known_model, sheet_episode, sheet_shape, without
from tests.simulation.scenes import frame_times, idle_controls, sheet_positions

LEVEL, ROLLED = np.eye(3), rotation(np.array([0.25, 0.0, 0.0]))
SEEN_THROUGH = 0.03
"""Metres of an object in the line of sight that hide a point; thinner rims are taken to be seen."""


def dome(radius: float = 0.08, count: int = 120) -> np.ndarray:
    """[count, 3] metres: the upper half of a ball on the table, as a camera sees a plush toy."""
    index = np.arange(count) + 0.5
    height, angle = index / count, np.pi * (1 + 5**0.5) * index
    flat = np.sqrt(1 - height**2)
    return radius * np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)


def at_rest(points: np.ndarray, frames: int = 12):
    """The points lying still; a hand comes near after that."""
    hand = np.tile(points[:1] + [0, 0, 0.3], (frames, 1, 1))
    hand[frames - 3 :] -= [0, 0, 0.29]
    return episode_of(np.tile(points, (frames, 1, 1)), hand)


def shape_of(episode, **options):
    return rest_shape(
        observed_at_rest(episode, still_frames(episode, see_hands(episode))),
        name=episode.name,
        ground=episode.ground_height,
        **{"max_nodes": 400, **options},
    )


def test_nodes_are_the_points_before_contact():
    shape = shape_of(sheet_episode())
    assert shape.positions == pytest.approx(sheet_shape().positions, abs=2e-4)
    assert shape.kind == "sheet"
    assert shape.surface.all()


def test_noise_is_averaged_over_the_frames_before_contact():
    generator = np.random.default_rng(3)
    points = np.tile(sheet_positions(), (60, 1, 1))
    episode = episode_of(points + generator.normal(0, 2e-3, points.shape), np.tile([[0, 0, 0.5]], (60, 1, 1)))
    still = still_frames(episode, see_hands(episode))
    assert still == 60
    mean = observed_at_rest(episode, still)
    assert np.abs(mean - points[0]).max() < 5 * 2e-3 / np.sqrt(60)


def test_points_seen_in_less_than_half_of_those_frames_are_left_out():
    episode = without(sheet_episode(), frames=slice(0, 8), points=slice(0, 3))
    assert len(shape_of(episode).positions) == 22


def test_too_many_points_are_thinned_evenly():
    points = sheet_positions(12, 0.02)
    shape = shape_of(at_rest(points), max_nodes=36)
    assert len(shape.positions) == 36
    gaps = np.linalg.norm(shape.positions[:, None] - shape.positions[None], axis=2) + np.eye(36)
    # Each node was the farthest from the others when it was chosen, so no point is left farther away than that.
    farthest = np.linalg.norm(points[:, None] - shape.positions[None], axis=2).min(axis=1).max()
    assert 0.02 < farthest <= gaps.min() + 1e-6


def test_points_at_one_place_become_one_node():
    points = sheet_positions()
    doubled = np.concatenate([points, points[3:6], points[3:4]])
    shape = shape_of(at_rest(doubled))
    assert shape.positions == pytest.approx(points, abs=1e-6)
    assert shape.spacing == shape_of(at_rest(points)).spacing


def test_spacing_is_that_of_a_grid_and_of_strewn_points_of_that_density():
    generator = np.random.default_rng(5)
    strewn = np.concatenate([generator.uniform(-0.3, 0.3, (900, 2)), np.zeros((900, 1))], axis=1)
    assert shape_of(at_rest(sheet_positions(10, 0.02))).spacing == pytest.approx(0.02, rel=0.05)
    assert shape_of(at_rest(strewn), max_nodes=1000).spacing == pytest.approx(0.02, rel=0.2)


def test_dome_is_a_solid_and_is_filled_inside():
    points = dome()
    shape = shape_of(at_rest(points))
    assert shape.kind == "solid"
    inside = shape.positions[~shape.surface]
    assert len(inside) > 10
    assert shape.surface[: len(points)].all()
    assert not shape.surface[len(points) :].any()
    footprint = points * [1, 1, 0]
    shell = np.concatenate([points, footprint])
    hull = Delaunay(shell[ConvexHull(shell).vertices])
    assert (hull.find_simplex(inside * [1, 1, 0.999]) >= 0).all()
    gaps = np.linalg.norm(inside[:, None] - points[None], axis=2).min(axis=1)
    assert gaps.min() > 0.5 * shape.spacing
    assert inside[:, 2].min() >= 0


ABOVE, LOW = np.array([-0.35, -0.35, 0.6]), np.array([0.0, -0.7, 0.4])
"""Metres: where the camera is."""


def seen_of_ellipsoid(
    turn: np.ndarray, *, camera: np.ndarray = ABOVE, seat: float = 1.0, count: int = 400
) -> tuple[np.ndarray, np.ndarray]:
    """An ellipsoid on the table as a camera sees it.

    Args:
        turn: [3, 3] how it lies.
        camera: [3] metres, where it is seen from.
        seat: height of its middle over that of an ellipsoid that stands on a point; what is below is cut off flat.

    Returns:
        [P, 3] metres, the points seen of `count` all over it, and [3] metres, its centre.
    """
    axes = np.array([0.06, 0.045, 0.055])
    index = np.arange(count) + 0.5
    height, angle = 1 - 2 * index / count, np.pi * (1 + 5**0.5) * index
    flat = np.sqrt(1 - height**2)
    unit = np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)
    centre = np.array([0.0, 0.0, np.linalg.norm(turn[2] * axes)])
    points = unit * axes @ turn.T + centre
    sight = camera - points
    sight = sight / np.linalg.norm(sight, axis=1, keepdims=True) @ turn / axes
    # Where the line from a point u of the unit ball along s leaves it: |u + t s| = 1.
    through = -2 * (unit * sight).sum(axis=1) / (sight**2).sum(axis=1)
    cut = (1 - seat) * centre[2] * np.array([0, 0, 1])
    return np.maximum(points - cut, [-1, -1, 0])[through < SEEN_THROUGH], centre - cut


def outside_of(seen: np.ndarray, spacing: float, points: np.ndarray) -> np.ndarray:
    """[K] metres by which points [K, 3] are outside of the convex hull of what is seen and of its foot."""
    low = seen[:, 2].min()
    foot = seen[seen[:, 2] < low + spacing] * [1, 1, 0] + [0, 0, low]
    planes = ConvexHull(np.concatenate([seen, foot])).equations
    return np.asarray((points @ planes[:, :3].T + planes[:, 3]).max(axis=1))


@pytest.mark.parametrize("turn", [LEVEL, ROLLED], ids=["level", "rolled"])
def test_half_seen_ellipsoid_gets_its_back(turn):
    seen, centre = seen_of_ellipsoid(turn)
    shape = shape_of(at_rest(seen))
    away = shape.positions.astype(np.float64).mean(axis=0) - centre
    # The middle of what is seen alone, filled, is a centimetre nearer to the camera and higher.
    alone = Delaunay(seen)
    sample = np.random.default_rng(0).uniform(seen.min(axis=0), seen.max(axis=0), (4000, 3))
    filled = sample[alone.find_simplex(sample) >= 0].mean(axis=0)
    assert np.linalg.norm((filled - centre)[:2]) > 0.008
    assert np.linalg.norm(away[:2]) < 0.004
    assert np.linalg.norm(away) < 0.006


@pytest.mark.parametrize("turn", [LEVEL, ROLLED], ids=["level", "rolled"])
def test_an_ellipsoid_seen_from_low_gets_its_back(turn):
    seen, centre = seen_of_ellipsoid(turn, camera=LOW, count=200)
    away = shape_of(at_rest(seen)).positions.astype(np.float64).mean(axis=0) - centre
    assert np.linalg.norm(away) < 0.006


@pytest.mark.parametrize("turn", [LEVEL, ROLLED], ids=["level", "rolled"])
def test_a_back_of_which_little_is_seen_weighs_as_much_as_the_front(turn):
    front, centre = seen_of_ellipsoid(turn, count=200)
    behind = seen_of_ellipsoid(turn, count=200, camera=-ABOVE)[0]
    seen = np.concatenate([front, behind[::6]])
    assert np.linalg.norm(seen.mean(axis=0) - centre) > 0.01
    shape = shape_of(at_rest(seen))
    assert np.linalg.norm(shape.positions.astype(np.float64).mean(axis=0) - centre) < 0.003


@pytest.mark.parametrize("turn", [LEVEL, ROLLED], ids=["level", "rolled"])
def test_the_back_is_no_surface_and_lies_on_the_table_not_under_it(turn):
    seen = seen_of_ellipsoid(turn, seat=0.7)[0]
    shape = shape_of(at_rest(seen))
    assert shape.surface.sum() == len(seen)
    assert shape.positions[shape.surface] == pytest.approx(seen, abs=1e-6)
    back = shape.positions[~shape.surface]
    assert (outside_of(seen, shape.spacing, back) > shape.spacing).any()
    assert back[:, 2].min() > -0.1 * shape.spacing
    gaps = np.linalg.norm(back[:, None] - seen[None], axis=2).min(axis=1)
    assert gaps.min() > 0.5 * shape.spacing


@pytest.mark.parametrize("turn", [LEVEL, ROLLED], ids=["level", "rolled"])
def test_half_seen_ellipsoid_rests_where_it_lies(turn):
    """Its springs as stiff as they may be: what moves it is only where its weight is."""
    shape = shape_of(at_rest(seen_of_ellipsoid(turn, seat=0.7, count=200)[0]))
    model = known_model(shape, stiffness_rate=1.0, damping_rate=1.0)
    result = rollout(batch_of_models([model], [idle_controls(frame_times(0.5, 1 / 30))], ground_height=0.0))
    result.raise_on_failure()
    assert np.linalg.norm(result.positions[0] - shape.positions, axis=2).max() < 2e-3


def test_an_object_seen_all_around_gets_no_back():
    heights = np.arange(120) + 0.5
    radius, angle = 0.06 * np.sqrt(heights / 120), np.pi * (1 + 5**0.5) * heights
    cone = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.1 * (1 - radius / 0.06)], axis=1)
    for seen in (cone, dome()):
        shape = shape_of(at_rest(seen))
        assert outside_of(seen, shape.spacing, shape.positions).max() < shape.spacing


def test_what_a_video_closed_already_gets_no_second_back():
    """Front and top of a box, and their image in a point that is not its middle: no image of both lies on both."""
    generator = np.random.default_rng(1)
    front = generator.uniform([-0.1, -0.072, 0.0], [0.1, -0.072, 0.07], (200, 3))
    top = generator.uniform([-0.1, -0.072, 0.0], [0.1, 0.1, 0.0], (400, 3))
    # Its top is vaulted, as what is reconstructed from few views is.
    top[:, 2] = 0.078 - 1.6 * (top[:, 0] ** 2 + (top[:, 1] - 0.01) ** 2)
    seen = np.concatenate([front, top])
    opposite = 2 * np.array([0.003, 0.02, 0.039]) - seen
    closed = np.concatenate([seen, np.maximum(opposite, [-1, -1, 0])])
    nodes = shape_of(at_rest(closed)).positions
    assert np.ptp(nodes, axis=0) == pytest.approx(np.ptp(closed, axis=0), abs=0.005)


def test_an_ellipsoid_that_has_both_symmetries_is_closed_below():
    """Seen from above it shows neither its back nor what it stands on; without that it would rock on a rim."""
    seen, centre = seen_of_ellipsoid(LEVEL, seat=0.95, count=400)
    shape = shape_of(at_rest(seen))
    below = shape.positions[shape.positions[:, 2] < 0.3 * shape.spacing, :2] - centre[:2]
    assert len(below) >= 4
    assert np.linalg.norm(below, axis=1).min() < shape.spacing
    assert np.linalg.norm(below.mean(axis=0)) < 0.5 * shape.spacing


def wedge() -> np.ndarray:
    """[P, 3] metres: all of a wedge but its underside; neither symmetry is its own."""
    corners = np.array(
        [[-0.06, -0.04, 0], [0.06, -0.04, 0], [-0.06, 0.04, 0], [0.06, 0.04, 0], [-0.06, -0.04, 0.08]]
        + [[0.06, -0.04, 0.08]]
    )
    faces = ((0, 1, 5), (0, 5, 4), (4, 5, 3), (4, 3, 2), (0, 4, 2), (1, 5, 3))
    generator = np.random.default_rng(0)
    points = np.concatenate([generator.dirichlet(np.ones(3), 300) @ corners[list(face)] for face in faces])
    return points[farthest_points(points, 160)]


def test_an_object_without_symmetry_gets_no_back():
    shape = shape_of(at_rest(wedge()))
    assert outside_of(wedge(), shape.spacing, shape.positions).max() < shape.spacing


def test_user_says_what_kind_the_object_is():
    assert shape_of(at_rest(dome()), kind="sheet").surface.all()
    assert shape_of(at_rest(sheet_positions()), kind="solid").kind == "solid"


def test_too_few_points_are_refused_with_their_number():
    with pytest.raises(
        EpisodeError, match=r"synthetic: 3 object point\(s\) seen before the first contact; .*at least 4"
    ):
        shape_of(at_rest(sheet_positions()[:3]))


def turned(points: np.ndarray, degrees: float, shift: tuple[float, float, float]) -> np.ndarray:
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return points @ turn.T + shift


def uneven_shape() -> np.ndarray:
    """[N, 3]: an L, which looks different from every side."""
    grid = sheet_positions(7, 0.03, 0.004).astype(np.float64)
    return grid[~((grid[:, 0] > 0.01) & (grid[:, 1] > -0.02))]


@pytest.mark.parametrize("degrees", [0, 10, 75, 180, -130])
def test_turned_and_shifted_object_is_placed_on_its_points(degrees):
    nodes = uneven_shape()
    observed = turned(nodes, degrees, (0.2, -0.1, 0.03))
    moved = placed(nodes, place(nodes, observed, spacing=0.03), nodes.mean(axis=0))
    assert np.abs(moved - observed).max() < 1e-4


@pytest.mark.parametrize("degrees", [0, 10, 75, 180, -130])
def test_object_turned_where_it_lies_is_placed_on_its_points(degrees):
    nodes = uneven_shape()
    observed = turned(nodes, degrees, (0, 0, 0))
    moved = placed(nodes, place(nodes, observed, spacing=0.03), nodes.mean(axis=0))
    assert np.abs(moved - observed).max() < 1e-4


def test_partly_hidden_object_is_placed_too():
    nodes = uneven_shape()
    observed = turned(nodes, 40, (0.1, 0.05, 0))
    seen = observed[np.linalg.norm(observed - observed[0], axis=1) > 0.05]
    moved = placed(nodes, place(nodes, seen, spacing=0.03), nodes.mean(axis=0))
    assert np.median(np.linalg.norm(moved - observed, axis=1)) < 5e-3


def test_object_already_in_place_is_left_to_the_bit():
    nodes = uneven_shape().astype(np.float32)
    pose = place(nodes, nodes + np.float32(0.002), spacing=0.03)
    assert not pose.any()
    assert np.array_equal(placed(nodes, pose, nodes.mean(axis=0)), nodes)


@pytest.mark.parametrize("noise", [0.0, 1.5e-3], ids=["exact", "noisy"])
def test_a_soft_toy_that_lies_askew_does_not_fall_over_by_itself(noise):
    """On its broad side, where it would rock back; seen from above, so that what it stands on has to be inferred."""
    seen, _ = seen_of_ellipsoid(rotation(np.array([np.pi / 2, 0.3, 0.0])))
    seen = seen + np.random.default_rng(7).normal(0.0, noise, seen.shape)
    shape = replace(shape_of(at_rest(seen)), grasp_radius=0.03)
    model = model_of(shape, {each.name: each.start for each in SEARCHED} | {"stiffness_rate": 8e4}, 0.0)
    result = rollout(batch_of_models([model], [idle_controls(frame_times(2.0, 1 / 30))], ground_height=0.0))
    result.raise_on_failure()
    assert np.linalg.norm(result.positions[0] - shape.positions, axis=2).max() < 5e-3
