"""Other twins: graphs and grasps beside which what the object feels helps, and what it does not feel does not."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.evidence.baseline_twin import TriedTwin, fit_baseline
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.evidence.other_twins import beside_other_twins, other_twins
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import TwinEffect
from egophys_core.kinds.rod import rod_model
from tests.diagnosis.cantilever import twin_of
from tests.diagnosis.rehearsed import WIND, episodes, sheet
from tests.diagnosis.verdict.test_decide import judged
from tests.kinds.hanging_cable import curve, moved_by_hand, record_of
from tests.kinds.seen_markers import marker_body


def effect(name, values):
    """A candidate that ended at these values."""
    parameters = {key: Estimate(value=value, unit="1", ci95=(value, value)) for key, value in values.items()}
    return replace(judged("quadratic_drag", 100.0), name=name, parameters=parameters)


DRAG = TwinEffect(name="quadratic_drag", values={"coefficient": 0.1})
"""What was named before."""


@pytest.fixture(scope="module")
def in_wind():
    """Two motions in a wind, the twin without it, and other twins of the sheet."""
    observations = [observe(sheet(), each) for each in episodes(WIND)]
    baseline = fit_baseline(observations, sheet(), starts=3, iterations=2)
    twin = replace(baseline.fitted.model, effects=(DRAG,))
    before = refit(observations, twin, baseline.fitted.parameters, iterations=1)
    return observations, before, other_twins(observations, before, baseline.tried, iterations=1)


def test_they_are_made_otherwise(in_wind):
    _, before, others = in_wind
    made = [
        (len(each.graph.springs), each.parameters.controller_radius)
        for each in (before.model, *(other.fitted.model for other in others))
    ]
    assert len(made) == 3
    assert all(one[0] != other[0] or abs(one[1] - other[1]) > 1e-3 for one, other in combinations(made, 2))


def test_they_carry_what_was_named_before(in_wind):
    _, _, others = in_wind
    assert [each.fitted.model.effects for each in others] == [(DRAG,)] * 2


def test_what_the_object_feels_gains_beside_each_and_what_it_does_not_feel_does_not(in_wind):
    observations, _, others = in_wind
    felt = effect(WIND.name, WIND.values)
    unfelt = effect("control_delay", {"delay": 0.02})
    felt, unfelt = (beside_other_twins(observations, each, others, iterations=1) for each in (felt, unfelt))
    assert felt.gains_beside_others.shape == unfelt.gains_beside_others.shape == (2,)
    assert felt.gains_beside_others.min() > 50.0
    assert unfelt.gains_beside_others.max() < 0.3 * felt.gains_beside_others.min()


def test_of_a_cable_there_is_one_graph_alone():
    moved = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=60))
    body = marker_body(moved, None)
    cable = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=1.0)
    observations = [observe_markers(twin_of(body, cable), moved)]
    before = refit(observations, cable, (), iterations=0)
    assert other_twins(observations, before, [TriedTwin(plain=cable, refitted=cable)], iterations=1) == []
    asked = beside_other_twins(observations, judged("quadratic_drag", 100.0), [], iterations=1)
    assert np.array_equal(asked.gains_beside_others, np.zeros(0))
