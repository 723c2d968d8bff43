"""The choice of the twin that predicts best, between two baselines."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import with_effect
from egophys_core.diagnosis.evidence.free_rollouts import FreeErrors
from egophys_core.diagnosis.evidence.predicting_twin import best_predicting, between, predicting_pair, shares_left
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import TwinEffect
from tests.diagnosis.rehearsed import WIND, episodes, sheet
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


def test_a_true_effect_leaves_little_of_the_errors_and_its_reverse_more_than_all():
    in_wind = [observe(sheet(), episode) for episode in episodes(WIND)]
    true, reverse = (
        with_effect(sheet(), WIND.name, {axis: sign * value for axis, value in WIND.values.items()})
        for sign in (1.0, -1.0)
    )
    assert shares_left(sheet(), true, in_wind).max() < 0.3
    assert shares_left(sheet(), reverse, in_wind).min() > 1.2
    # Beside the true one nothing is left for a second.
    second = with_effect(true, "quadratic_drag", {"coefficient": 0.0})
    assert shares_left(true, second, in_wind) == pytest.approx(1.0)


def test_the_pair_keeps_what_each_carries():
    seen = [observe(sheet(), episodes(WIND)[0])]
    true = with_effect(sheet(), WIND.name, dict(WIND.values))
    before, after, errors = predicting_pair(sheet(), true, seen, given=1)
    assert (before.effects, after.effects) == ((), true.effects)
    assert [np.nanmean(after.track) < np.nanmean(before.track) for before, after in errors] == [True]
    same, also, _ = predicting_pair(true, true, seen, given=1)
    assert same.effects == also.effects == true.effects
