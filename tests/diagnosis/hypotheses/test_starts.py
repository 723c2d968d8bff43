"""Where refits start: from a rival's twin the path to the true effect is short."""

from types import SimpleNamespace

import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import effect_values, with_effect
from egophys_core.diagnosis.evidence.refit import robust_loss
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.hypotheses.starts import starts_from_rival
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import LIBRARY
from tests.diagnosis.rehearsed import WIND, episodes, sheet

SCALE = 1e-3


@pytest.fixture(scope="module")
def observed():
    """The sheet in a wind, lifted."""
    return [observe(sheet(), episodes(WIND)[0])]


@pytest.fixture(scope="module")
def starts(observed):
    """Paths to a wind of half the size from a twin that is right but for an attraction in the wind's place."""
    rival = with_effect(sheet(), "point_attraction", {"x": 0.3, "y": -0.2, "z": 0.1, "strength": 0.5, "range": 0.3})
    half = {"x": 0.75, "y": -0.5, "z": 0.0}
    ranked = SimpleNamespace(probe=SimpleNamespace(effect=LIBRARY[WIND.name]), starts=({"x": 0.5, "y": 0.0, "z": 0.0},))
    return starts_from_rival(observed, ranked, half, rival, SCALE)


def test_starts_carry_the_effect_and_no_longer_the_rival(starts):
    assert len(starts) == 2
    assert all([term.name for term in start.effects] == [WIND.name] for start in starts)


def test_the_best_start_is_at_the_true_size(starts):
    assert effect_values(starts[0], WIND.name) == pytest.approx(WIND.values)


def test_the_best_comes_first(observed, starts):
    found = residuals(observed, starts)[0]
    assert robust_loss([found[0]], SCALE) < robust_loss([found[1]], SCALE)
