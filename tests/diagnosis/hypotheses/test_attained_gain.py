"""What an effect would gain in a world that has it, after a refit of the twin without it."""

from dataclasses import replace

import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, with_effect
from egophys_core.diagnosis.evidence.refit import refit, refit_further, robust_loss
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.hypotheses.attained_gain import AttainedGains, InjectedEffect
from egophys_core.diagnosis.hypotheses.ranking import Probe
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import LIBRARY
from tests.diagnosis.rehearsed import WIND, episodes, sheet


@pytest.fixture(scope="module")
def still():
    """Two motions of a sheet that lacks nothing, as its twin follows them."""
    observations = [observe(sheet(), each) for each in episodes()]
    return observations, refit(observations, sheet(), baseline_parameters(sheet()), iterations=1)


def probe(name, values):
    effect = LIBRARY[name]
    return Probe(effect=effect, start={**{each.name: 0.0 for each in effect.parameters}, **values}, slopes=[])


def steps_of(name, parameter, size):
    return size / next(each.step for each in LIBRARY[name].parameters if each.name == parameter)


def wind(size):
    steps = steps_of(WIND.name, "x", size)
    return InjectedEffect(probe=probe(WIND.name, WIND.values), size="x", steps=steps, needed_gain=20.0)


def test_no_effect_gains_nothing_and_more_of_it_gains_more(still):
    gains = AttainedGains(*still)([wind(size) for size in (0.0, 1.0, 3.0)])
    assert gains[0] == pytest.approx(0.0, abs=5.0)
    assert gains[0] < gains[1] < gains[2]


def test_the_twin_takes_up_a_part_of_it(still):
    observations, fitted = still
    (gain,) = AttainedGains(*still)([wind(3.0)])
    windy = residuals(observations, [with_effect(fitted.model, WIND.name, {"x": 3.0, "y": 0.0, "z": 0.0})])
    unfitted = [2.0 * own - each[0] for own, each in zip(fitted.residuals, windy, strict=True)]
    assert 0.0 < gain < robust_loss(unfitted, fitted.scale) - fitted.loss


def test_side_by_side_no_world_is_fitted_much_worse_than_by_a_refit_of_its_own(still, monkeypatch):
    observations, fitted = still
    sizes = (2.0, 3.0)
    gains = AttainedGains(*still)([wind(size) for size in sizes])
    for size, gain in zip(sizes, gains, strict=True):
        windy = residuals(observations, [with_effect(fitted.model, WIND.name, {"x": size, "y": 0.0, "z": 0.0})])
        added = [own - each[0] for own, each in zip(fitted.residuals, windy, strict=True)]
        monkeypatch.setattr(
            "egophys_core.diagnosis.evidence.refit.residuals",
            lambda episodes, models, added=added: [
                found + more for found, more in zip(residuals(episodes, models), added, strict=True)
            ],
        )
        start = replace(fitted, residuals=[own + more for own, more in zip(fitted.residuals, added, strict=True)])
        alone = refit_further(observations, start, iterations=6, turns=False).loss - fitted.loss
        assert gain < 1.2 * alone


def test_of_an_effect_that_the_twin_has_more_is_meant():
    windy = replace(sheet(), effects=(WIND,))
    observations = [observe(sheet(), each) for each in episodes(WIND)]
    gains_of = AttainedGains(observations, refit(observations, windy, baseline_parameters(windy), iterations=1))
    gains = gains_of([wind(size) for size in (0.0, 3.0)])
    assert gains[0] == pytest.approx(0.0, abs=5.0)
    assert gains[1] > 20.0
