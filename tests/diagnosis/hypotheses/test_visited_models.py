"""Models that were simulated say how residuals change about them."""

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.hypotheses.visited_models import VisitedModels
from egophys_core.diagnosis.tracked_episode import observe
from tests.diagnosis.rehearsed import episodes, sheet


@pytest.fixture(scope="module")
def fitted():
    observations = [observe(sheet(), each) for each in episodes()[:1]]
    return observations, refit(observations, sheet(), baseline_parameters(sheet()), iterations=0)


def unit(index, size):
    return np.eye(size)[index]


def test_at_first_there_is_the_twin_alone_with_its_slopes(fitted):
    visited = VisitedModels(*fitted)
    own = fitted[1].jacobian[0]
    seen = np.isfinite(own).all(axis=-1) & np.isfinite(fitted[1].residuals[0])
    assert len(visited.positions) == 1
    assert visited.has_neighbours(0)
    np.testing.assert_array_equal(visited.slopes(0), own[seen])


def test_about_a_model_slopes_agree_with_what_was_simulated_there(fitted):
    visited = VisitedModels(*fitted)
    count = visited.positions.shape[1]
    visited.visit([visited.positions[0] + 2.0 * unit(0, count)])
    before = visited.slopes(1)
    visited.visit_neighbours([1])
    assert visited.has_neighbours(1)
    moves = visited.positions[2:] - visited.positions[1]
    there = visited.left[2:] - visited.left[1]

    def missed(slopes):
        return np.linalg.norm(there - moves @ slopes.T)

    assert missed(visited.slopes(1)) < 0.35 * missed(before)


def test_models_that_diverge_are_not_kept(fitted, monkeypatch):
    visited = VisitedModels(*fitted)
    monkeypatch.setattr(
        VisitedModels, "simulated", lambda self, models: np.full((len(models), self.left.shape[1]), np.inf)
    )
    visited.visit([visited.positions[0]])
    assert len(visited.positions) == len(visited.left) == 1
