"""Refits: known numbers come back from a far start, and parameters stay within their bounds."""

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import (
    baseline_parameters,
    effect_parameters,
    effect_values,
    with_effect,
)
from egophys_core.diagnosis.evidence.refit import refit, refit_from, residual_scale, robust_loss
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import LIBRARY
from tests.diagnosis.cantilever import body_and_model
from tests.diagnosis.rehearsed import WIND, episodes, sheet
from tests.effects.situations import solid
from tests.identification.synthetic import make_episode


@pytest.mark.parametrize("index", range(len(baseline_parameters(sheet()))))
def test_a_parameter_reads_what_it_was_set_to(index):
    parameter = baseline_parameters(sheet())[index]
    at = parameter.position(sheet())
    step = 1.0 if parameter.read(sheet()) < parameter.definition.high else -1.0
    assert parameter.position(parameter.to(sheet(), at + step)) == pytest.approx(at + step, abs=1e-4)
    far = parameter.read(parameter.to(sheet(), 1e6))
    assert far == pytest.approx(parameter.definition.high, rel=1e-5)


def test_a_force_comes_back_with_its_direction_and_size():
    observations = [observe(sheet(), episode) for episode in episodes(WIND)]
    start = with_effect(sheet(), WIND.name, {"x": 0.0, "y": 0.0, "z": 0.0})
    fitted = refit(observations, start, effect_parameters(LIBRARY[WIND.name]), iterations=8)
    found = effect_values(fitted.model, WIND.name)
    assert [found[axis] for axis in "xyz"] == pytest.approx([1.5, -1.0, 0.0], abs=0.2)


def test_residuals_of_what_diverged_have_the_scale_that_is_evidence():
    observations = [observe(sheet(), episodes(WIND)[0])]
    sizes = [np.array([0.0, 2e-3, 4e-3, 0.1, np.nan])]
    assert residual_scale(observations, sizes) == pytest.approx(3e-3)
    assert residual_scale(observations, [np.full(5, np.inf)]) == observations[0].least_scale


def test_a_refit_never_ends_worse_than_it_began():
    observations = [observe(sheet(), episode) for episode in episodes(WIND)]
    fitted = refit(observations, sheet(), baseline_parameters(sheet()), iterations=2)
    start = [each[0] for each in residuals(observations, [sheet()])]
    assert fitted.loss <= robust_loss(start, fitted.scale) + 1e-6
    assert [each.shape[-1] for each in fitted.jacobian] == [len(baseline_parameters(sheet()))] * 2
    assert np.isfinite(fitted.jacobian[0]).any()


def test_a_refit_without_hope_ends_after_its_first_steps():
    observations = [observe(sheet(), episodes(WIND)[0])]
    parameters = effect_parameters(LIBRARY[WIND.name])
    starts = [with_effect(sheet(), WIND.name, {"x": 0.0, "y": 0.0, "z": at}) for at in (6.0, 8.0)]
    ends = [
        refit_from(observations, starts, parameters, scale=1e-3, iterations=6, hopeless=loss).loss
        for loss in (0.0, np.inf)
    ]
    assert ends[1] < ends[0]


def test_a_sheet_that_damps_its_bending_less_than_its_twin_assumed_is_refitted_so():
    (ratio,) = [each for each in baseline_parameters(sheet()) if each.definition.name == "bending_damping_ratio"]
    assumed = ratio.read(sheet())
    assert ratio.definition.high == assumed
    episode = make_episode(ratio.write(sheet(), 1.0), name="flick", duration=3.2, carry=(-0.15, 0.12, 0.2))
    fitted = refit([observe(sheet(), episode)], sheet(), [ratio], iterations=8)
    assert ratio.read(fitted.model) == pytest.approx(1.0, rel=0.5)


def test_only_cloth_may_give_way_when_it_is_pressed():
    def names(model):
        return {parameter.definition.name for parameter in baseline_parameters(model)}

    assert "compression_ratio" in names(sheet()) - names(solid())


def test_only_a_toy_in_a_hand_has_its_weight_fitted():
    def names(model):
        return {parameter.definition.name for parameter in baseline_parameters(model)}

    clamped = body_and_model()[1]
    assert "gravity" in names(solid())
    assert "gravity" not in names(clamped) | names(sheet())
    assert names(clamped) | {"gravity"} == names(solid())
