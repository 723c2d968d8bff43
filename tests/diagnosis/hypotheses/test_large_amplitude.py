"""Large-amplitude probes: the sizes they go to, and what counts as a gain there."""

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import effect_values
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.hypotheses.large_amplitude import (
    LargeAmplitudeProbe,
    at_large_amplitudes,
    large_amplitude_gains,
)
from egophys_core.effects import LIBRARY
from tests.effects.situations import sheet

SCALE = 1e-3
SHAPE = (30, 12, 3)


@pytest.fixture
def noise():
    return np.random.default_rng(0).normal(0, SCALE, SHAPE)


@pytest.fixture
def lacking():
    """What an effect that the twin lacks does to its residuals."""
    return np.random.default_rng(1).normal(0, 4 * SCALE, SHAPE)


@pytest.fixture
def baseline():
    """What one number of the twin does to them."""
    return np.random.default_rng(2).normal(0, 2 * SCALE, SHAPE)


def gains(at_twin, baseline, **large_amplitude_probes):
    problem = linear_problem([at_twin], [baseline[..., None]], SCALE)
    return large_amplitude_gains(
        problem, [LargeAmplitudeProbe(name=name, residuals=[each]) for name, each in large_amplitude_probes.items()]
    )


def test_a_large_amplitude_changes_sizes_and_leaves_places_where_they_are():
    start = {"x": 0.1, "y": 0.2, "z": 0.3, "strength": 1.0, "range": 0.15}
    found = [
        effect_values(each, "point_attraction")
        for each in at_large_amplitudes(sheet(), LIBRARY["point_attraction"], start)
    ]
    assert [each["strength"] for each in found] == pytest.approx([-3.0, 3.0, 9.0])
    assert all({**each, "strength": 1.0} == pytest.approx(start) for each in found)


def test_no_large_amplitude_ends_where_the_effect_vanishes():
    for effect in LIBRARY.values():
        start = {each.name: each.low if each.null is None else each.null + each.step for each in effect.parameters}
        for model in at_large_amplitudes(sheet(), effect, start):
            values = effect_values(model, effect.name)
            assert any(values[each.name] != each.null for each in effect.parameters if each.null is not None)


def test_what_explains_the_residuals_gains_and_what_does_not_gains_nothing(noise, lacking, baseline):
    found = gains(lacking + noise, baseline, right=noise, wrong=2.0 * lacking + noise, nothing=lacking + noise)
    assert found["right"] > 100.0
    assert found["wrong"] == 0.0
    assert found["nothing"] == pytest.approx(0.0, abs=1e-9)


def test_a_baseline_that_bent_to_make_up_for_the_effect_is_moved_back(noise, lacking, baseline):
    bent = noise + 1.5 * baseline
    assert gains(lacking + noise, baseline, effect=bent)["effect"] == pytest.approx(
        gains(lacking + noise, baseline, effect=noise)["effect"], rel=0.05
    )


def test_the_best_probe_of_an_effect_counts_and_one_that_diverged_does_not(noise, lacking, baseline):
    problem = linear_problem([lacking + noise], [baseline[..., None]], SCALE)
    large_amplitude_probes = [np.full(SHAPE, np.inf), noise, lacking]
    found = large_amplitude_gains(
        problem, [LargeAmplitudeProbe(name="effect", residuals=[each]) for each in large_amplitude_probes]
    )
    assert found == pytest.approx(gains(lacking + noise, baseline, effect=noise))
    assert (
        large_amplitude_gains(problem, [LargeAmplitudeProbe(name="effect", residuals=[np.full(SHAPE, np.inf)])]) == {}
    )
