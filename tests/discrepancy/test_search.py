"""What is worth a refit: what slopes promise, and what leaps do."""

import numpy as np

from egophys_core.discrepancy.effects import LIBRARY
from egophys_core.discrepancy.knobs import base_knobs
from egophys_core.discrepancy.leaps import Leap
from egophys_core.discrepancy.ranking import Probe
from egophys_core.discrepancy.refit import Fitted
from egophys_core.discrepancy.search import Survey
from tests.discrepancy.effects.situations import sheet

SCALE = 1e-3
SHAPE = (30, 12, 3)


def test_an_effect_without_slopes_is_worth_a_refit_if_a_leap_gains():
    generator = np.random.default_rng(0)
    noise, missed, odd = (generator.normal(0, size * SCALE, SHAPE) for size in (1, 4, 4))
    starts = {"gravity_scale": {"scale": 0.9}, "quadratic_drag": {"coefficient": 5.0}, "tracking_scale": {"scale": 1.1}}
    slopes = {"gravity_scale": np.zeros(SHAPE), "quadratic_drag": -missed, "tracking_scale": np.zeros(SHAPE)}
    survey = Survey(
        fitted=Fitted(
            model=sheet(),
            residuals=[missed + noise],
            jacobian=[np.zeros((*SHAPE, 0))],
            knobs=base_knobs(sheet(), clamped=False)[:0],
            scale=SCALE,
        ),
        probes=[
            Probe(effect=LIBRARY[name], start=start, slopes=[slopes[name][..., None]]) for name, start in starts.items()
        ],
        leaps=[
            Leap(name="gravity_scale", residuals=[noise]),
            Leap(name="tracking_scale", residuals=[missed + odd + noise]),
        ],
        on_rods={},
    )
    ranking, worth = survey.ranking(SCALE, shams=5, seed=0)
    assert ranking.ranked[0].name == "quadratic_drag"
    assert {each.name for each in worth} == {"gravity_scale", "quadratic_drag"}
