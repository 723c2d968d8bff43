"""Relaxation is measured in ring-downs of a cantilever of our simulator, whatever its twin is."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from egophys_core.diagnosis.direct.measure import measure
from egophys_core.diagnosis.direct.measured import MeasuredEffect
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import TwinEffect
from egophys_core.episode import Episode
from tests.diagnosis.cantilever import body_and_model, ring_down_episode, twin_of

RELAXES = {"ratio": 0.15, "time": 0.5}
FLOWS = {"ratio": 0.5, "time": 8.0}
LOADS_N = (0.0, 0.03, 0.06)
FRAMES = 300


@cache
def records(*, numbers: tuple[tuple[str, float], ...] = ()) -> list[Episode]:
    """The cantilever let go with three loads, its material with a Maxwell arm of these numbers."""
    body, model = body_and_model()
    effects = (TwinEffect(name="viscoelasticity", values=dict(numbers)),) if numbers else ()
    random = np.random.default_rng(0)
    found = []
    for index, load in enumerate(LOADS_N):
        episode = ring_down_episode(body, replace(model, effects=effects), load=load, frames=FRAMES)
        noise = random.normal(scale=1e-5, size=episode.points.shape)
        found.append(replace(episode, name=f"load {index}", points=(episode.points + noise).astype(np.float32)))
    return found


def measured(episodes: list[Episode], *, validation: int = 0, without: tuple[str, ...] = ()) -> list[MeasuredEffect]:
    """What is measured in episodes, of which the last ones are not fitted, beside a twin that is far too soft."""
    body, model = body_and_model()
    twin = twin_of(body, replace(model, stiffness=0.5 * model.stiffness))
    observed: list[TrackedEpisode] = [observe_markers(twin, episode) for episode in episodes]
    fitted = observed[: len(observed) - validation]
    return measure(fitted, observed[len(fitted) :], lies_flat=False, without=without, resamples=100, seed=0)


def test_relaxation_is_measured_with_its_numbers() -> None:
    (found,) = measured(records(numbers=tuple(RELAXES.items())), validation=1)
    assert found.name == "viscoelasticity"
    assert found.shows
    assert found.values["ratio"] == pytest.approx(RELAXES["ratio"], rel=0.15)
    assert found.values["time"] == pytest.approx(RELAXES["time"], rel=0.15)
    assert found.validation_gain is not None
    assert min(found.held_out_gain, found.validation_gain) > 12.0
    assert found.p_null < 0.05
    assert "off them by" in found.reason


def test_springs_alone_do_not_relax() -> None:
    (found,) = measured(records())
    assert not found.shows
    assert found.held_out_gain < 6.0


def test_what_is_not_seen_to_end_may_be_flow() -> None:
    (found,) = measured(records(numbers=tuple(FLOWS.items())))
    assert found.held_out_gain > 12.0
    assert [each.name for each in found.criteria if not each.passed] == ["seen_to_end"]


def test_records_that_ask_for_other_numbers_do_not_agree() -> None:
    """One record relaxes and the other does not: a clamp that slips once is no material."""
    (found,) = measured([records(numbers=tuple(RELAXES.items()))[0], records()[1]])
    assert not found.shows


def test_nothing_is_measured_where_nothing_swings() -> None:
    episodes = records(numbers=tuple(RELAXES.items()))
    assert measured(episodes[:1]) == []
    assert measured(episodes, without=("viscoelasticity",)) == []
    still = replace(episodes[1], points=np.repeat(episodes[1].points[:1], FRAMES, axis=0))
    assert measured([episodes[0], still]) == []


def test_what_is_no_oscillator_says_nothing() -> None:
    episodes = []
    for episode in records(numbers=tuple(RELAXES.items()))[:2]:
        points = episode.points.copy()
        extent = np.ptp(points[:, :, 2])
        points[..., 2] += (0.3 * extent * np.sin(9.0 * episode.times**1.5) * (episode.times > 0.5))[:, None]
        episodes.append(replace(episode, points=points.astype(np.float32)))
    assert measured(episodes) == []
