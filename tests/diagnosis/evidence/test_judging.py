"""Judging: what an effect gains in an episode that took no part in the fit."""

from dataclasses import replace

import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, with_effect
from egophys_core.diagnosis.evidence.judging import validated
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.tracked_episode import observe
from tests.diagnosis.rehearsed import WIND, episodes, sheet
from tests.diagnosis.verdict.test_decide import judged


@pytest.fixture(scope="module")
def gains():
    """Of the true wind, its reverse, and no wind, on another baseline, in an episode in that wind.

    What was fitted was followed to 10 cm only; residuals in this episode count by how well it is followed.
    """
    held_out = [observe(sheet(), episodes(WIND)[1])]
    before = refit(held_out, sheet(), (), iterations=0, scale=0.1)
    baseline = replace(sheet(), parameters=replace(sheet().parameters, damping=3.0 * sheet().parameters.damping))
    models = [
        with_effect(sheet(), WIND.name, dict(WIND.values)),
        with_effect(sheet(), WIND.name, {axis: -value for axis, value in WIND.values.items()}),
        with_effect(baseline, WIND.name, dict.fromkeys(WIND.values, 0.0)),
    ]
    effects = [judged("quadratic_drag", 10.0, fitted=replace(before, model=model)) for model in models]
    return [each.validation_gains for each in validated(effects, before, held_out)]


def test_the_true_effect_gains_in_an_episode_that_was_not_fitted(gains):
    assert gains[0].shape == (1,)
    assert gains[0][0] > 50.0


def test_its_reverse_loses(gains):
    assert gains[1].shape == (1,)
    assert gains[1][0] < 0.0


def test_an_episode_that_would_not_show_an_effect_says_nothing_of_it(gains):
    assert gains[2].shape == (0,)


def test_a_baseline_that_fits_other_motions_only_refutes_nothing():
    held_out = [observe(sheet(), episodes(WIND)[1])]
    stiff = replace(sheet(), stiffness=4.0 * sheet().stiffness)
    before = refit(held_out, stiff, baseline_parameters(sheet()), iterations=0, scale=1e-3)
    bent = replace(before, model=with_effect(stiff, WIND.name, dict(WIND.values)))
    (effect,) = validated([judged("quadratic_drag", 100.0, fitted=bent)], replace(before, model=sheet()), held_out)
    assert effect.validation_gains[0] > 50.0
