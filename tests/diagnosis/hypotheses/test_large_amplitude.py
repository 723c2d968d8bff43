"""Leaps: the sizes they go to, and what counts as a gain there."""

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import effect_values
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.hypotheses.large_amplitude import LEAPS, Leap, leap_gains, leapt
from egophys_core.effects import LIBRARY
from tests.effects.situations import sheet

SCALE = 1e-3
SHAPE = (30, 12, 3)


@pytest.fixture
def noise():
    return np.random.default_rng(0).normal(0, SCALE, SHAPE)


@pytest.fixture
def missed():
    """What an effect that the twin lacks does to its residuals."""
    return np.random.default_rng(1).normal(0, 4 * SCALE, SHAPE)


@pytest.fixture
def base():
    """What one number of the twin does to them."""
    return np.random.default_rng(2).normal(0, 2 * SCALE, SHAPE)


def gains(at_twin, base, **leaps):
    problem = linear_problem([at_twin], [base[..., None]], SCALE)
    return leap_gains(problem, [Leap(name=name, residuals=[each]) for name, each in leaps.items()])


def test_a_leap_changes_sizes_and_leaves_places_where_they_are():
    start = {"x": 0.1, "y": 0.2, "z": 0.3, "strength": 1.0, "range": 0.15}
    found = [effect_values(each, "point_attraction") for each in leapt(sheet(), LIBRARY["point_attraction"], start)]
    assert [each["strength"] for each in found] == pytest.approx(LEAPS)
    assert all({**each, "strength": 1.0} == pytest.approx(start) for each in found)


def test_no_leap_ends_where_the_effect_vanishes():
    for effect in LIBRARY.values():
        start = {each.name: each.low if each.null is None else each.null + each.step for each in effect.parameters}
        for model in leapt(sheet(), effect, start):
            values = effect_values(model, effect.name)
            assert any(values[each.name] != each.null for each in effect.parameters if each.null is not None)


def test_what_explains_the_residuals_gains_and_what_does_not_gains_nothing(noise, missed, base):
    found = gains(missed + noise, base, right=noise, wrong=2.0 * missed + noise, nothing=missed + noise)
    assert found["right"] > 100.0
    assert found["wrong"] == 0.0
    assert found["nothing"] == pytest.approx(0.0, abs=1e-9)


def test_a_base_that_bent_to_make_up_for_the_effect_is_turned_back(noise, missed, base):
    bent = noise + 1.5 * base
    assert gains(missed + noise, base, effect=bent)["effect"] == pytest.approx(
        gains(missed + noise, base, effect=noise)["effect"], rel=0.05
    )


def test_the_best_leap_of_an_effect_counts_and_one_that_diverged_does_not(noise, missed, base):
    problem = linear_problem([missed + noise], [base[..., None]], SCALE)
    leaps = [np.full(SHAPE, np.inf), noise, missed]
    found = leap_gains(problem, [Leap(name="effect", residuals=[each]) for each in leaps])
    assert found == pytest.approx(gains(missed + noise, base, effect=noise))
    assert leap_gains(problem, [Leap(name="effect", residuals=[np.full(SHAPE, np.inf)])]) == {}
