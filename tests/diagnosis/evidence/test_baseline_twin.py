"""The baseline twin: the best of some graphs and grasps, on a small sheet of our own simulator."""

import pytest

from egophys_core.diagnosis.evidence.baseline_twin import fit_baseline, follows
from egophys_core.diagnosis.evidence.refit import robust_loss
from egophys_core.diagnosis.evidence.residuals import observe, residuals
from tests.diagnosis.rehearsed import away, episodes, fallen, sheet


@pytest.fixture(scope="module")
def observations():
    return [observe(sheet(), episode) for episode in episodes()]


def losses(observations, models, scale):
    found = residuals(observations, models)
    return [robust_loss([each[row] for each in found], scale) for row in range(len(models))]


def test_the_baseline_explains_more_than_the_twin_and_all_else_it_was_chosen_from(observations):
    baseline = fit_baseline(observations, sheet(), starts=4, iterations=2)
    of_twin, *of_others = losses(observations, [sheet(), *baseline.others], baseline.fitted.scale)
    assert baseline.fitted.loss < of_twin
    assert baseline.fitted.loss < min(of_others)


@pytest.mark.parametrize(("starts", "runners_up"), [(1, 0), (2, 1), pytest.param(4, 1, marks=pytest.mark.slow)])
def test_of_the_starts_half_go_on_until_two_or_three_are_left(observations, starts, runners_up):
    baseline = fit_baseline(observations, sheet(), starts=starts, iterations=0)
    assert len(baseline.others) == 2 + runners_up


def test_an_episode_in_which_the_object_went_elsewhere_is_not_followed(observations):
    fitted = fit_baseline(observations, sheet(), starts=1, iterations=0).fitted
    assert follows(fitted, [observe(sheet(), each) for each in (away(), fallen())]) == [True, False]
    assert follows(fitted, []) == []
