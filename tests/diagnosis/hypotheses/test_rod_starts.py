"""Starts on rods: an effect is found beside a twin that is out of phase without it."""

from dataclasses import replace

import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, effect_values, with_effect
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.hypotheses.ranking import probe_effects, rank
from egophys_core.diagnosis.hypotheses.rod_starts import rod_starts
from egophys_core.effects import LIBRARY
from egophys_core.kinds.rod import rigidity_of, rod_model
from tests.diagnosis.cantilever import twin_of
from tests.kinds.hanging_cable import curve, moved_by_hand, record_of, rolled_out
from tests.kinds.seen_markers import marker_body

RIGIDITY = 0.02
"""m^4/s^2, of the cable."""


LIKE_IT = {"gravity_scale", "constant_body_force", "tracking_scale", "quadratic_drag", "uneven_mass"}
"""Effects that change how fast and how far it swings."""


@pytest.fixture(scope="module")
def light():
    """What a bar leaves of a cable that weighs too little, and where effects start on rods."""
    moved = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=140), aside=0.1)
    body = marker_body(moved, None)
    cable = rod_model(body, density=1000.0, rigidity=RIGIDITY, retardation_time=0.015, drag=0.0)
    injected = with_effect(cable, "gravity_scale", {"scale": 0.8})
    bar = rod_model(body, density=1000.0, rigidity=100.0 * RIGIDITY, retardation_time=1e-4, drag=20.0)
    seen = replace(moved, points=rolled_out(injected, body, moved))
    observations = [observe_markers(twin_of(body, bar), seen)]
    before = refit(observations, bar, baseline_parameters(bar), iterations=0)
    probes = probe_effects(
        observations, bar, before.residuals, without=LIBRARY.keys() - LIKE_IT, progress=lambda share: None
    )
    ranking = rank(linear_problem(before.residuals, before.jacobian, before.scale), probes, surrogates=0, seed=0)
    shares = []
    starts = rod_starts(observations, bar, ranking.ranked, before.scale, progress=shares.append)
    return before, starts, shares


def test_the_effect_is_found_on_a_rod_of_about_the_right_rigidity(light):
    before, starts, _ = light
    best = starts["gravity_scale"][0]
    assert effect_values(best.model, "gravity_scale")["scale"] == pytest.approx(0.85)
    parameters = best.model.parameters
    per_length = parameters.total_mass / best.model.graph.rest_lengths.sum()
    assert parameters.flexural_rigidity / per_length == pytest.approx(RIGIDITY, rel=0.7)
    assert parameters.drag == 0.0
    assert best.loss(before.scale) < 0.6 * before.loss


def test_it_leaves_less_than_any_other_effect(light):
    before, starts, _ = light
    losses = {name: found[0].loss(before.scale) for name, found in starts.items()}
    assert min(losses, key=losses.__getitem__) == "gravity_scale"


def test_a_few_starts_of_each_effect_are_kept_the_best_first(light):
    before, starts, shares = light
    for name, found in starts.items():
        assert len(found) == 3
        losses = [start.loss(before.scale) for start in found]
        assert losses == sorted(losses)
        assert all([term.name for term in start.model.effects] == [name] for start in found)
    assert shares[-1] == pytest.approx(1.0)


def test_a_rod_bends_over_its_bending_length():
    assert rigidity_of(0.1) == pytest.approx(9.81e-3)
