"""The choice of the twin that predicts best, between two baselines."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.free_rollouts import FreeErrors
from egophys_core.diagnosis.evidence.predicting_twin import best_predicting, between
from egophys_core.effects import TwinEffect
from tests.simulation.scenes import sheet_model, sheet_positions


def errors(track_m: float) -> FreeErrors:
    frames = np.array([np.nan, track_m, track_m])
    return FreeErrors(track=frames, chamfer=frames, last_residual_track=frames)


def test_models_between_lead_in_equal_steps_from_one_to_the_other():
    one = sheet_model(sheet_positions(4), stiffness=50.0, friction=0.2)
    drag = TwinEffect(name="quadratic_drag", values={"coefficient": 3.0})
    other = replace(sheet_model(sheet_positions(4), stiffness=200.0, friction=0.6), effects=(drag,))
    found = between(one, other)
    assert len(found) == 5
    assert not any(each.effects for each in found)
    assert [each.parameters.friction for each in found] == pytest.approx([0.2, 0.3, 0.4, 0.5, 0.6], abs=0.02)
    stiffness = [float(np.median(each.stiffness)) for each in found]
    assert np.diff(np.log(stiffness)) == pytest.approx(np.log(4.0) / 4.0, rel=1e-3)


def test_nothing_is_between_twins_of_other_graphs():
    one, other = (sheet_model(sheet_positions(side)) for side in (4, 5))
    assert [len(each.graph.positions) for each in between(one, other)] == [16, 25]


def test_the_best_is_best_in_the_mean_of_ratios():
    # By 0.5 and 1.5 of a third episode the second gains more than it loses.
    of_episodes = [[errors(0.010), errors(0.005)], [errors(0.002), errors(0.003)]]
    assert best_predicting(of_episodes) == 1
    assert best_predicting([*of_episodes, [errors(0.002), errors(0.003)]]) == 0


def test_what_diverges_is_not_chosen():
    assert best_predicting([[errors(np.inf), errors(0.03)], [errors(0.001), errors(0.03)]]) == 1
