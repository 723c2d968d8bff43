"""The baseline twin: the best of some graphs and grasps, on a small sheet of our own simulator."""

import pytest

from egophys_core.diagnosis.evidence.baseline_twin import fit_baseline, follows
from egophys_core.diagnosis.evidence.refit import losses_of
from egophys_core.diagnosis.tracked_episode import observe
from tests.diagnosis.rehearsed import away, episodes, fallen, sheet


@pytest.fixture(scope="module")
def observations():
    return [observe(sheet(), episode) for episode in episodes()]


def test_the_baseline_explains_more_than_the_twin_and_all_else_it_was_chosen_from(observations):
    baseline = fit_baseline(observations, sheet(), starts=4, iterations=2)
    of_twin, *of_others = losses_of(observations, [sheet(), *baseline.others], baseline.fitted.scale)
    assert baseline.fitted.loss < of_twin
    assert baseline.fitted.loss < min(of_others)


@pytest.mark.parametrize(("starts", "runners_up"), [(1, 0), pytest.param(4, 2, marks=pytest.mark.slow)])
def test_of_each_graph_and_grasp_one_is_tried_and_the_best_are_starts_of_effects(observations, starts, runners_up):
    baseline = fit_baseline(observations, sheet(), starts=starts, iterations=0)
    made = {(len(each.plain.graph.springs), each.plain.parameters.controller_radius) for each in baseline.tried}
    assert len(made) == len(baseline.tried) == starts
    assert len(baseline.others) == 2 + runners_up
    found = losses_of(observations, [each.refitted for each in baseline.tried], baseline.fitted.scale)
    assert found[0] == min(found)


def test_an_episode_in_which_the_object_went_elsewhere_is_not_followed(observations):
    fitted = fit_baseline(observations, sheet(), starts=1, iterations=0).fitted
    assert follows(fitted, [observe(sheet(), each) for each in (away(), fallen())]) == [True, False]
    assert follows(fitted, []) == []
