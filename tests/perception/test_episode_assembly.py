"""Observations to an episode, without any images."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.episode_assembly import EpisodeAssembly
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import Completion, ObjectKind, PerceptionOptions
from egophys_core.perception.surface.rest_surface import RestObject
from tests.perception.observations import observations
from tests.perception.surface.surface_scene import object_at_rest

OPTIONS = PerceptionOptions(object_points=60, controllers=5)
STAY = np.array([[1.0, 0, 0], [0, 1, 0]])
GRIP = 4


def seen(count: int = 10, *, grip: int | None = GRIP) -> list[Observation]:
    """Observations of a hand that holds the object from a frame on, then all are sure."""
    found = observations(count)
    result = []
    for frame, each in enumerate(found):
        held = grip is not None and frame >= grip
        result.append(
            replace(
                each,
                confidence=np.ones(len(each.points)),
                hand_points=each.hand_points if held else np.full_like(each.hand_points, np.nan),
                hand_motion=STAY if frame > 0 else None,
            )
        )
    return result


def assembled(
    given: list[Observation], rest: RestObject | None = None, options: PerceptionOptions = OPTIONS
) -> EpisodeAssembly:
    assembly = EpisodeAssembly(options=options, rest=rest or object_at_rest("sheet"))
    for each in given:
        assembly.add(each)
    return assembly


def test_times_points_and_ids() -> None:
    given = seen()
    assembly = assembled(given)
    episode = assembly.episode("drawn", 0.0)
    assert assembly.start_ns == given[0].view.stamp_ns
    np.testing.assert_allclose(np.diff(episode.times), 1 / 30, atol=1e-4)
    assert episode.points.shape == (10, 60, 3)
    assert len(np.unique(episode.point_ids)) == 60
    # Each column is one and the same point of the observations.
    first = [int(np.argmin(np.linalg.norm(given[0].points - point, axis=1))) for point in episode.points[0]]
    assert len(set(first)) == 60
    np.testing.assert_allclose(episode.points[-1], given[-1].points[first], atol=1e-5)


def test_points_are_spread_over_the_object() -> None:
    given = seen()
    episode = assembled(given).episode("drawn", 0.0)
    assert np.ptp(episode.points[0], axis=0)[:2] == pytest.approx(np.ptp(given[0].points, axis=0)[:2], rel=0.05)


def test_unsure_points_are_left_out() -> None:
    given = seen()
    given[3] = replace(given[3], confidence=np.full(len(given[3].points), 0.49))
    episode = assembled(given).episode("drawn", 0.0)
    assert np.isnan(episode.points[3]).all()
    assert (episode.confidence[3] == 0).all()
    assert np.isfinite(episode.points[4]).all()


def test_points_deep_in_the_table_are_left_out() -> None:
    given = seen()
    sunk = given[5].points.copy()
    sunk[:, 2] = -0.0051
    given[5] = replace(given[5], points=sunk)
    assert np.isnan(assembled(given).episode("drawn", 0.0).points[5]).all()
    assert np.isfinite(assembled(given).episode("drawn", -0.01).points[5]).any()


def test_a_point_that_jumps_is_left_out() -> None:
    given = seen()
    chosen = assembled(given).episode("drawn", 0.0).points[0, 7]
    jumping = int(np.argmin(np.linalg.norm(given[0].points - chosen, axis=1)))
    moved = given[6].points.copy()
    moved[jumping] += [0.1, 0, 0.05]
    given[6] = replace(given[6], points=moved)
    episode = assembled(given).episode("drawn", 0.0)
    assert np.isnan(episode.points[6]).any(axis=1).sum() == 1


def test_points_that_are_never_sure_have_no_column() -> None:
    given = seen()
    half = np.arange(len(given[0].points)) % 2 == 0
    episode = assembled([replace(each, confidence=np.where(half, 1.0, 0.1)) for each in given]).episode("drawn", 0.0)
    assert 10 < episode.points.shape[1] < 55
    assert np.isfinite(episode.points).all()


def test_hand_goes_back_along_its_motion_to_the_first_view() -> None:
    assembly = assembled(seen())
    episode = assembly.episode("drawn", 0.0)
    assert assembly.grip_frame == GRIP
    assert episode.controllers.shape == (10, 5, 3)
    assert np.isfinite(episode.controllers).all()
    np.testing.assert_allclose(episode.controllers[GRIP], seen()[GRIP].hand_points, atol=1e-5)


def test_hand_that_is_lost_stays_where_it_was() -> None:
    given = seen()
    for frame in (7, 8):
        given[frame] = replace(given[frame], hand_points=np.full((5, 3), np.nan))
    episode = assembled(given).episode("drawn", 0.0)
    np.testing.assert_array_equal(episode.controllers[7], episode.controllers[6])
    np.testing.assert_allclose(episode.controllers[9], given[9].hand_points, atol=1e-5)


def test_hand_that_appears_stays_where_it_appeared() -> None:
    given = seen()
    given[3] = replace(given[3], hand_motion=None)
    episode = assembled(given).episode("drawn", 0.0)
    np.testing.assert_array_equal(episode.controllers[0], episode.controllers[3])


def test_without_a_grip_there_are_no_controllers() -> None:
    assembly = assembled(seen(grip=None))
    assert assembly.grip_frame == -1
    assert assembly.episode("drawn", 0.0).controllers.shape == (10, 0, 3)


def test_hidden_side_of_a_solid_is_there_until_the_grip() -> None:
    dome = object_at_rest("dome")
    episode = assembled(seen(), dome).episode("drawn", 0.0)
    added = episode.points[:, 60:]
    assert added.shape[1] == 30
    assert np.isfinite(added[:GRIP]).all()
    assert np.isnan(added[GRIP:]).all()
    assert (episode.confidence[:GRIP, 60:] == 0.5).all()
    assert not episode.confidence[GRIP:, 60:].any()


@pytest.mark.parametrize("completion", [Completion.SYMMETRIC, Completion.NONE])
def test_sheets_are_not_completed_and_solids_only_if_wanted(completion: Completion) -> None:
    options = replace(OPTIONS, completion=completion)
    assert assembled(seen(), options=options).episode("drawn", 0.0).points.shape[1] == 60
    solid = assembled(seen(), object_at_rest("dome"), options).episode("drawn", 0.0).points.shape[1]
    assert solid == (90 if completion == Completion.SYMMETRIC else 60)
    assert object_at_rest("dome").kind == ObjectKind.SOLID


def test_one_view_is_an_error() -> None:
    with pytest.raises(EpisodeError, match="1 view"):
        assembled(seen(1)).episode("drawn", 0.0)


def test_nothing_sure_is_an_error_or_an_episode_that_says_so() -> None:
    given = [replace(each, confidence=np.zeros(len(each.points))) for each in seen()]
    with pytest.raises(EpisodeError):
        assembled(given).episode("drawn", 0.0)
