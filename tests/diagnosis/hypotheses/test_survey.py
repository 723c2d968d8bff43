"""What effects promise by a survey: which of them is worth a refit."""

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters
from egophys_core.diagnosis.evidence.refit import Fitted
from egophys_core.diagnosis.hypotheses.large_amplitude import LargeAmplitudeProbe
from egophys_core.diagnosis.hypotheses.ranking import Probe
from egophys_core.diagnosis.hypotheses.survey import Survey
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.effects import LIBRARY
from tests.effects.situations import sheet

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
