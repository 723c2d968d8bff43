"""What falls tell: how something fell comes back, and by which effects."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from egophys_core.diagnosis.direct.free_fall import fallen, falls_in, motion_of
from egophys_core.diagnosis.direct.free_fall_effects import fall_limits, free_fall_effects, measured_by_falls
from egophys_core.diagnosis.direct.measured import MeasuredEffect, Recordings
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.effects import LIBRARY
from egophys_core.episode import Episode
from egophys_core.observation import observe_episode
from tests.observation.falling import dropped
from tests.observation.test_contact import ball

NAMES = measured_by_falls(sorted(LIBRARY))
G = 9.81

NO_AIR = np.zeros((11, 3, 3))
"""[F, 3, 3] how what carries no air faces."""

GRID = np.stack(np.meshgrid(np.linspace(-0.15, 0.15, 10), np.linspace(-0.2, 0.2, 13), [0.0]), axis=-1).reshape(-1, 3)
"""[N, 3] a sheet, about its middle."""


def tracked(episode: Episode) -> Any:
    """What is asked of an episode that was prepared for a twin."""
    seen = observe_episode(episode)
    known = np.isfinite(seen.episode.points[0]).all(axis=1)
    return SimpleNamespace(
        rest=seen.at_rest,
        problem=SimpleNamespace(start=ball()),
        episode=seen.episode,
        observed=seen,
        tracks=SimpleNamespace(positions=seen.episode.points[:, known]),
    )


def found(*episodes: Episode, validation: tuple[Episode, ...] = (), names: list[str] = NAMES) -> list[MeasuredEffect]:
    recordings = Recordings(
        fitted=[tracked(each) for each in episodes],
        validation=[tracked(each) for each in validation],
        lies_flat=False,
        resamples=0,
        seed=0,
        thresholds=Thresholds(),
    )
    return free_fall_effects(names, recordings)


def falling_sheet(
    *,
    acceleration: tuple[float, float, float] = (0.0, 0.0, -G),
    carried: float = 0.0,
    hidden: float = 0.0,
    turns: float = 2.0,
) -> Any:
    """A sheet that turns while it falls, tracked without noise but for what a sheet swings by.

    Args:
        acceleration: [3] m/s^2 of what carries no air.
        carried: air along its normal, over its mass.
        hidden: share of its length that nobody sees.
        turns: rad/s.
    """
    times = np.arange(11) / 30.0
    angles = 0.7 + 0.7 * (turns == 0.0) + turns * times
    normals = np.stack([np.zeros(11), -np.sin(angles), np.cos(angles)], axis=1)
    motion = np.array([*acceleration, 0.0, carried])
    faces = np.einsum("fi,fj->fij", normals, normals)
    middles = 0.9 * np.eye(3)[2] + fallen(times, velocity=np.array([0.1, 0.2, 0.3]), motion=motion, normals=faces)
    along = np.stack([np.zeros(11), np.cos(angles), np.sin(angles)], axis=1)
    places = middles[:, None] + GRID[:, 0, None] * np.eye(3)[0] + GRID[:, 1, None] * along[:, None]
    places += 2e-4 * np.random.default_rng(1).normal(size=(11, 1, 3))
    places[:, GRID[:, 1] < -0.2 + 0.4 * hidden] = np.nan
    return SimpleNamespace(
        rest=GRID,
        problem=SimpleNamespace(start=GRID),
        episode=SimpleNamespace(times=times, ground_height=0.0),
        observed=SimpleNamespace(falls=(0,), hangs=False, contact=np.zeros((11, 1), np.uint8), delay=0.0),
        tracks=SimpleNamespace(positions=places),
    )


def found_in_sheet(*falls: Any) -> list[MeasuredEffect]:
    return free_fall_effects(
        NAMES,
        Recordings(fitted=falls, validation=[], lies_flat=True, resamples=0, seed=0, thresholds=Thresholds()),
    )


def shown(effects: list[MeasuredEffect]) -> list[MeasuredEffect]:
    return [each for each in effects if each.shows]


def test_a_fall_without_air_is_a_parabola():
    times, velocity, motion = np.array([0.0, 0.1, 0.37]), np.array([0.3, 0.0, -0.2]), np.array([0.5, 0.0, -G, 0.0, 0.0])
    expected = times[:, None] * velocity + 0.5 * times[:, None] ** 2 * motion[:3]
    assert fallen(times, velocity=velocity, motion=motion, normals=NO_AIR[:3]) == pytest.approx(expected, abs=1e-12)


def test_what_falls_long_in_air_falls_by_the_logarithm_of_a_hyperbolic_cosine():
    # x = ln(cosh(sqrt(g c) t)) / c of what falls from rest (Batchelor's quadratic drag).
    times, drag = np.linspace(0.0, 0.5, 6), 14.0
    x = np.log(np.cosh(np.sqrt(G * drag) * times)) / drag
    moved = fallen(times, velocity=np.zeros(3), motion=np.array([0.0, 0.0, -G, drag, 0.0]), normals=NO_AIR[:6])
    assert moved[:, 2] == pytest.approx(-x, abs=2e-4)


@pytest.mark.parametrize("thrown", [(0.0, 0.0, 0.0), (0.4, -0.2, 0.3)])
@pytest.mark.parametrize("motion", [(0.0, 0.0, -G, 0.0, 0.0), (1.2, -0.7, -6.0, 0.0, 0.0), (0.0, 0.0, -G, 5.0, 0.0)])
def test_how_it_fell_comes_back_however_it_was_let_go(thrown: tuple[float, ...], motion: tuple[float, ...]):
    times = np.arange(9) / 30.0
    places = 0.3 + fallen(times, velocity=np.array(thrown), motion=np.array(motion), normals=NO_AIR[:9])
    again, _, missed = motion_of(times, places, NO_AIR[:9])
    assert again == pytest.approx(motion, abs=1e-3)
    assert np.abs(missed).max() < 1e-6


def test_what_carries_air_falls_along_its_normal_as_if_it_were_heavier():
    times, slope = np.array([0.0, 0.2, 0.4]), np.array([0.0, 0.6, 0.8])
    faces = np.broadcast_to(np.outer(slope, slope), (3, 3, 3))
    moved = fallen(times, velocity=np.zeros(3), motion=np.array([0.0, 0.0, -G, 0.0, 1.5]), normals=faces)
    # Along the normal by a gravity over 2.5, and across it by all of gravity.
    gravity = np.array([0.0, 0.0, -G])
    expected = gravity - slope * (gravity @ slope) * (1.0 - 1.0 / 2.5)
    assert moved == pytest.approx(0.5 * times[:, None] ** 2 * expected, abs=1e-12)


def test_air_that_a_sheet_carries_is_told_from_a_tilt():
    (air,) = shown(found_in_sheet(falling_sheet(carried=0.8)))
    assert air.name == "added_mass"
    assert air.values["ratio"] == pytest.approx(0.8, abs=0.1)
    assert f"it carries {air.values['ratio']:.2f} of its mass in air" in air.reason
    (tilt,) = shown(found_in_sheet(falling_sheet(acceleration=(0.4, 1.1, -G))))
    assert [tilt.name, *(each.name for each in tilt.alike)] == ["gravity_tilt", "constant_body_force"]
    assert tilt.alike[0].values["y"] == pytest.approx(1.1, abs=0.1)


def test_effects_that_gain_as_much_in_a_fall_are_named_together():
    # What falls on its edge, and does not turn, is pushed aside by the air that it carries as by a tilt.
    (named,) = shown(found_in_sheet(falling_sheet(carried=0.5, turns=0.0)))
    assert {named.name, *(each.name for each in named.alike)} >= {"added_mass", "gravity_tilt"}


@pytest.mark.parametrize("hidden", [0.0, 0.2])
def test_a_sheet_that_falls_freely_shows_nothing_whatever_is_hidden_of_it(hidden: float):
    effects = found_in_sheet(falling_sheet(hidden=hidden))
    assert sorted(each.name for each in effects) == NAMES
    assert not shown(effects)


def test_a_sheet_of_which_half_is_hidden_tells_nothing():
    assert found_in_sheet(falling_sheet(hidden=0.5)) == []


def test_frames_that_hide_half_of_a_sheet_are_left_out_and_the_others_tell():
    air, hides = falling_sheet(carried=0.8), falling_sheet(carried=0.8, hidden=0.5)
    air.tracks.positions[[4, 9]] = hides.tracks.positions[[4, 9]]
    (named,) = shown(found_in_sheet(air))
    assert named.values["ratio"] == pytest.approx(0.8, abs=0.1)
    air.tracks.positions[2:7] = hides.tracks.positions[2:7]
    assert found_in_sheet(air) == []


def test_what_turns_as_it_falls_shows_nothing_but_what_is_there():
    # Half of it is seen, and goes round the rest: 1.6 rad in the fall.
    assert not shown(found(dropped(2.81, spin=5.0)))
    (gravity,) = shown(found(dropped(2.81, spin=5.0, acceleration=(0.0, 0.0, -0.7 * G))))
    assert gravity.name == "gravity_scale"
    assert gravity.values["scale"] == pytest.approx(0.7, abs=0.04)
    assert not shown(found(dropped(2.81, spin=9.0)))


@pytest.mark.parametrize("noise", [0.0015, 0.005])
def test_a_solid_of_which_few_points_are_tracked_tells_its_gravity_too(noise: float):
    few = slice(None, None, 14)
    episode = dropped(2.81, acceleration=(0.0, 0.0, -0.5 * G), noise=noise)
    episode = replace(
        episode,
        points=episode.points[:, few],
        confidence=episode.confidence[:, few],
        point_ids=episode.point_ids[few],
    )
    (gravity,) = shown(found(episode))
    low, high = gravity.parameters["scale"].ci95
    assert low < 0.5 < high
    assert high - low < 0.5


def test_what_turns_faster_tells_less():
    slow, fast = (
        fall_limits(["gravity_tilt"], [tracked(dropped(2.81, spin=each))], lies_flat=False, needed=12.0)[0].size
        for each in (1.0, 5.0)
    )
    assert slow is not None
    assert fast is not None
    assert slow < 0.06 < fast


def test_gravity_is_named_by_one_fall_and_not_the_force_that_does_the_same():
    (gravity,) = shown(found(dropped(2.81, acceleration=(0.0, 0.0, -0.7 * G))))
    assert gravity.name == "gravity_scale"
    low, high = gravity.parameters["scale"].ci95
    assert low < 0.7 < high
    assert high - low < 0.15
    assert not gravity.alike


def test_what_is_pulled_aside_is_two_things():
    (tilt,) = shown(found(dropped(2.81, acceleration=(0.0, 0.9, -G))))
    assert [tilt.name, *(each.name for each in tilt.alike)] == ["gravity_tilt", "constant_body_force"]
    assert tilt.alike[0].values["y"] == pytest.approx(0.9, abs=0.1)
    assert "as it would by constant_body_force or tracking_rotation" in tilt.reason


def test_one_fall_is_not_said_to_tell_what_it_cannot():
    falls = [dropped(each, acceleration=(0.0, 0.0, -0.7 * G)) for each in (2.81, 3.83)]
    (one,), (both,) = shown(found(falls[0])), shown(found(*falls))
    assert "one fall does not tell it from time_varying_body_force or point_attraction: let it fall" in one.reason
    assert "one fall" not in both.reason


def test_drag_is_told_from_a_gravity_that_is_less():
    (drag,) = shown(found(dropped(2.81, drag=6.0), dropped(2.83, drag=6.0)))
    assert drag.name == "quadratic_drag"
    assert drag.values["coefficient"] == pytest.approx(6.0, rel=0.1)


def test_nothing_injected_nothing_shows():
    effects = found(dropped(2.81))
    assert sorted(each.name for each in effects) == NAMES
    assert not shown(effects)


def test_another_fall_that_shows_nothing_speaks_against_an_effect():
    assert not shown(found(dropped(2.81, acceleration=(0.9, 0.0, -G)), validation=(dropped(2.83),)))


def test_two_falls_that_are_pulled_to_opposite_sides_show_nothing():
    sides = [dropped(2.81 + 0.01 * side, acceleration=(0.9 * side, 0.0, -G)) for side in (1, -1)]
    assert not shown(found(*sides))


def test_points_that_are_recorded_late_fall_late():
    episode = dropped(2.81, acceleration=(0.0, 0.0, -0.7 * G))
    late = replace(episode, points=episode.points[np.maximum(np.arange(episode.frames) - 4, 0)])
    assert observe_episode(late).delay == pytest.approx(4 / 30, abs=0.02)
    (gravity,) = shown(found(late))
    assert gravity.values["scale"] == pytest.approx(0.7, abs=0.05)


@pytest.mark.parametrize("short", [{"rate": 10.0}, {"acceleration": (0.0, 0.0, -40.0)}])
def test_what_falls_for_too_few_frames_tells_nothing(short: dict[str, Any]):
    assert found(dropped(2.81, **short)) == []


def test_what_was_never_let_go_tells_nothing():
    assert not falls_in(tracked(dropped(2.81, acceleration=(0.0, 0.0, 0.0))), lies_flat=False)


def test_limits_are_the_sizes_that_are_named():
    observed = [tracked(dropped(2.81))]
    limits = fall_limits(["gravity_scale"], observed, lies_flat=False, needed=Thresholds().measured_gain)
    (size,) = (each.size for each in limits)
    assert size is not None
    assert shown(found(dropped(2.81, acceleration=(0.0, 0.0, -G * (1 - 1.5 * size)))))
    assert not shown(found(dropped(2.81, acceleration=(0.0, 0.0, -G * (1 - 0.5 * size)))))
    assert fall_limits(["gravity_scale"], [], lies_flat=False, needed=1.0) == []


def test_noise_of_the_tracks_is_in_the_limits():
    # It is told from a fall's own misses: 1.5 and 8 mm of each of a hundred tracks.
    sizes = [
        fall_limits(["gravity_tilt"], [tracked(dropped(2.81, noise=noise, seed=2))], lies_flat=False, needed=12.0)[
            0
        ].size
        for noise in (0.0015, 0.008)
    ]
    assert sizes[0] is not None
    assert sizes[1] is not None
    assert sizes[1] > 1.3 * sizes[0]
