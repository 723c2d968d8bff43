"""Ring-downs of an oscillator whose equation stands here: what relaxes is found, with its numbers, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from egophys_core.diagnosis.direct.ring_down import RingDown, ring_down_of
from egophys_core.diagnosis.direct.ring_down_fit import explained_ring_downs, fit_ring_downs, ring_down_gains
from egophys_core.episode import Episode

DEFLECTIONS_M, RATES, DAMPING_RATES = (0.006, 0.012), (45.0, 25.0), (5.0, 3.0)
"""Of two records: metres, rad/s, 1/s."""

NOISE_M = 1e-5
NOTHING = {"ratio": 0.0, "time": 1.0}
RELAXES = {"ratio": 0.1, "time": 0.8}


def record(index: int, *, ratio: float, time: float, seconds: float = 4.0, flows: float = 0.0) -> Episode:
    """Three markers on an object that is let go: y'' = -w^2 (y - e + ratio (y - q)) - c y', q' = (y - q) / time.

    Args:
        index: which of the two records.
        ratio: of the arm.
        time: of the arm, s.
        seconds: how long.
        flows: m/s at which its middle e sinks besides.
    """
    rate, damping, deflection = RATES[index], DAMPING_RATES[index], DEFLECTIONS_M[index]

    def change(t: float, state: np.ndarray) -> list[float]:
        place, speed, relaxed = state
        spring = rate**2 * (place + deflection + flows * t + ratio * (place - relaxed))
        return [speed, -spring - damping * speed, (place - relaxed) / time]

    times = np.arange(0.0, seconds, 0.01)
    height = solve_ivp(change, (0.0, seconds), [0.0, 0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-12).y[0]
    markers = np.array([[0.1, -0.01, 0.5], [0.1, 0.01, 0.5], [0.1, 0.0, 0.48]])
    points = markers + height[:, None, None] * [0.0, 0.0, 1.0]
    points += np.random.default_rng(index).normal(scale=NOISE_M, size=points.shape)
    clamp = np.array([[0.0, -0.01, 0.5], [0.0, 0.01, 0.5], [0.0, 0.0, 0.48]])
    return Episode(
        name=f"record {index}",
        times=times,
        points=points.astype(np.float32),
        confidence=np.ones(points.shape[:2], np.float32),
        point_ids=np.arange(3, dtype=np.uint32),
        controllers=np.repeat(clamp[None], len(times), axis=0).astype(np.float32),
        controller_ids=np.arange(3, dtype=np.uint32),
    )


def ring_downs(*episodes: Episode) -> list[RingDown]:
    found = [ring_down_of(episode) for episode in episodes]
    assert all(found)
    return [each for each in found if each is not None]


def test_what_relaxes_is_found_with_its_numbers() -> None:
    both = ring_downs(*(record(index, **RELAXES) for index in (0, 1)))
    found = fit_ring_downs(both)
    assert found.ratio == pytest.approx(RELAXES["ratio"], rel=0.05)
    assert found.time == pytest.approx(RELAXES["time"], rel=0.05)
    for name, (low, high) in found.ci95.items():
        assert low < getattr(found, name) < high
    assert (ring_down_gains(both, explained_ring_downs(both), found) > 20.0).all()
    assert np.sqrt(found.squares).max() < 3.0 * NOISE_M


def test_numbers_of_one_record_explain_the_other() -> None:
    one, other = ring_downs(record(0, **RELAXES), record(1, **RELAXES))
    found = fit_ring_downs([one])
    after = explained_ring_downs([other], found.ratio, found.time)
    assert ring_down_gains([other], explained_ring_downs([other]), after)[0] > 20.0


def test_a_plain_ring_down_gains_nothing() -> None:
    both = ring_downs(*(record(index, **NOTHING) for index in (0, 1)))
    assert ring_down_gains(both, explained_ring_downs(both), fit_ring_downs(both)).sum() < 3.0


def test_the_middle_and_the_stiffness_of_each_record_are_its_own() -> None:
    """A record mounted higher is the same ring-down: nothing is blamed on the material."""
    episode = record(0, **RELAXES)
    moved = replace(episode, points=episode.points + np.float32([0.0, 0.0, 0.003]))
    here, there = (fit_ring_downs(ring_downs(each)) for each in (episode, moved))
    assert there.ratio == pytest.approx(here.ratio, rel=1e-2)


def test_a_ring_down_goes_along_most_motion_from_where_it_first_turns_back() -> None:
    (ring_down,) = ring_downs(record(1, **NOTHING))
    turn = np.pi / RATES[1]
    assert ring_down.earlier_times[0] == pytest.approx(-turn, abs=0.003)
    assert abs(ring_down.earlier[0] - ring_down.places[0]) == pytest.approx(2.0 * DEFLECTIONS_M[1], rel=0.15)
    assert ring_down.rate == pytest.approx(RATES[1], rel=0.05)


def test_hidden_frames_are_left_out() -> None:
    episode = record(0, **RELAXES)
    points = episode.points.copy()
    points[40:60, 1] = np.nan
    (ring_down,) = ring_downs(
        replace(episode, points=points, confidence=np.isfinite(points).all(axis=2).astype(np.float32))
    )
    assert len(ring_down.times) + len(ring_down.earlier_times) == len(episode.times) - 20 + 1
    assert fit_ring_downs([ring_down]).ratio == pytest.approx(RELAXES["ratio"], rel=0.1)


@pytest.mark.parametrize("why", ["not let go", "clamp moves", "too short"])
def test_what_does_not_swing_in_a_clamp_says_nothing(why: str) -> None:
    episode = record(0, **NOTHING)
    points, held = episode.points.copy(), episode.controllers.copy()
    if why == "not let go":
        points[:] = points[0]
    elif why == "clamp moves":
        held[200:] += np.float32([0.01, 0.0, 0.0])
    else:
        episode, points, held = record(0, **NOTHING, seconds=0.2), points[:20], held[:20]
    assert ring_down_of(replace(episode, points=points, controllers=held)) is None
