"""What is worth a refit, by slopes and by large-amplitude probes; and what a search calls unexplained."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.diagnosis import Outcome
from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.evidence.refit import Fitted, refit
from egophys_core.diagnosis.hypotheses.large_amplitude import LargeAmplitudeProbe
from egophys_core.diagnosis.hypotheses.ranking import Probe
from egophys_core.diagnosis.hypotheses.search import Survey, search
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.problem import DiagnosisProblem
from egophys_core.effects import LIBRARY
from egophys_core.kinds.rod import rod_model
from tests.diagnosis.cantilever import twin_of
from tests.effects.situations import sheet
from tests.kinds.hanging_cable import curve, moved_by_hand, record_of, rolled_out
from tests.kinds.seen_markers import marker_body

SCALE = 1e-3
SHAPE = (30, 12, 3)


def test_an_effect_without_slopes_is_worth_a_refit_if_a_large_amplitude_probe_gains():
    generator = np.random.default_rng(0)
    noise, lacking, odd = (generator.normal(0, size * SCALE, SHAPE) for size in (1, 4, 4))
    starts = {"gravity_scale": {"scale": 0.9}, "quadratic_drag": {"coefficient": 5.0}, "tracking_scale": {"scale": 1.1}}
    slopes = {"gravity_scale": np.zeros(SHAPE), "quadratic_drag": -lacking, "tracking_scale": np.zeros(SHAPE)}
    survey = Survey(
        fitted=Fitted(
            model=sheet(),
            residuals=[lacking + noise],
            jacobian=[np.zeros((*SHAPE, 0))],
            parameters=baseline_parameters(sheet())[:0],
            scale=SCALE,
        ),
        probes=[
            Probe(effect=LIBRARY[name], start=start, slopes=[slopes[name][..., None]]) for name, start in starts.items()
        ],
        large_amplitude_probes=[
            LargeAmplitudeProbe(name="gravity_scale", residuals=[noise]),
            LargeAmplitudeProbe(name="tracking_scale", residuals=[lacking + odd + noise]),
        ],
        on_rods={},
    )
    promise = survey.promise(SCALE, surrogates=5, seed=0)
    assert promise.ranking.ranked[0].name == "quadratic_drag"
    worth = promise.worth_a_refit(8.0)
    assert {each.name for each in worth} == {"gravity_scale", "quadratic_drag"}
    criteria = promise.criteria(worth, DiagnosisOptions(shortlist=1), 8.0)
    failed = {name: [each.name for each in results if not each.passed] for name, results in criteria.items()}
    assert failed == {worth[0].name: [], worth[1].name: ["shortlist"], "tracking_scale": ["worth_a_refit"]}
    assert "needs at least 8 to be worth a refit" in criteria["tracking_scale"][0].sentence


@pytest.mark.slow
def test_a_cable_that_goes_where_nothing_pulls_it_is_unexplained():
    moved = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=140))
    body = marker_body(moved, None)
    cable = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=1.0)
    wobble = 0.03 * np.sin(2.0 * np.pi * 4.0 * moved.times)[:, None, None]
    seen = replace(moved, points=(rolled_out(cable, body, moved) + wobble).astype(np.float32))
    observations = [observe_markers(twin_of(body, cable), seen)]
    before = refit(observations, cable, baseline_parameters(cable), iterations=0)
    problem = DiagnosisProblem(
        observations=observations, validation=(), options=DiagnosisOptions(refit_iterations=1, bootstraps=50), seed=0
    )
    found = search(problem, before, LIBRARY.keys() - {"quadratic_drag"}, lambda stage, share: None)
    verdict = found.verdict
    assert verdict.outcome == Outcome.UNEXPLAINED
    assert verdict.decision.rule == "large_residual"
    assert [each.candidate for each in verdict.decision.nearest_misses] == ["quadratic_drag"]
    assert not all(each.passed for each in found.criteria["quadratic_drag"])
    assert "where a twin that lacks nothing leaves" in verdict.reason
