"""What a search calls unexplained."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.diagnosis import Outcome
from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.problem import DiagnosisProblem
from egophys_core.diagnosis.verdict.search import search
from egophys_core.effects import LIBRARY
from egophys_core.kinds.rod import rod_model
from tests.diagnosis.cantilever import twin_of
from tests.kinds.hanging_cable import curve, moved_by_hand, record_of, rolled_out
from tests.kinds.seen_markers import marker_body


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
    found = search(problem, before, LIBRARY.keys() - {"quadratic_drag"}, lambda stage, share: None, tried=[])
    verdict = found.verdict
    assert verdict.outcome == Outcome.UNEXPLAINED
    assert verdict.decision.rule == "large_residual"
    assert [each.candidate for each in verdict.decision.nearest_misses] == ["quadratic_drag"]
    assert not all(each.passed for each in found.criteria["quadratic_drag"])
    assert "where a twin that lacks nothing leaves" in verdict.reason
