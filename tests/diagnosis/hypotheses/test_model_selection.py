"""Model selection: a special case gets its chance where a general effect led, and so does the twin without any."""

from dataclasses import replace

import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, effect_values, with_effect
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.hypotheses.model_selection import select_models
from egophys_core.diagnosis.hypotheses.ranking import probe_effects, rank
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.problem import DiagnosisProblem
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import LIBRARY
from egophys_core.kinds.rod import rod_model
from tests.diagnosis.cantilever import twin_of
from tests.diagnosis.rehearsed import WIND, episodes, sheet
from tests.kinds.hanging_cable import curve, moved_by_hand, record_of, rolled_out
from tests.kinds.seen_markers import marker_body

SCALE = 1e-3


def selected(model, recorded, chosen, others):
    """A selection among an effect and others of the library on episodes of the sheet, and the twin it begins with."""
    observations = [observe(sheet(), episode) for episode in recorded]
    return selected_in(observations, model, baseline_parameters(model), chosen, others)


def selected_in(observations, model, parameters, chosen, others):
    """The same in episodes in which the twin has its place already."""
    before = refit(observations, model, parameters, iterations=0, scale=SCALE)
    without = LIBRARY.keys() - {chosen, *others}
    probes = probe_effects(observations, model, before.residuals, without=without, progress=lambda share: None)
    ranking = rank(linear_problem(before.residuals, before.jacobian, SCALE), probes, surrogates=0, seed=0)
    options = DiagnosisOptions(refit_iterations=4)
    ended = select_models(
        DiagnosisProblem(observations=observations, validation=(), options=options, seed=0),
        before,
        {each.name: each for each in ranking.ranked},
        [chosen],
        (),
        lambda stage, share: None,
        earlier={},
        others=(),
        far={},
    )
    return before, ended


@pytest.fixture(scope="module")
def wind():
    """Attraction to a point is asked whether it explains a steady wind."""
    others = ("constant_body_force", "gravity_tilt", "quadratic_drag")
    return selected(sheet(), episodes(WIND), "point_attraction", others)


@pytest.mark.slow
def test_the_special_case_of_what_explains_much_is_refitted_though_nobody_asked_for_it(wind):
    _, ended = wind
    assert {"point_attraction", "constant_body_force", "gravity_tilt"} <= set(ended.fits)
    force = effect_values(ended.fits["constant_body_force"].model, "constant_body_force")
    assert [force["x"], force["y"]] == pytest.approx([1.5, -1.0], abs=0.4)


@pytest.mark.slow
def test_with_an_effect_the_loss_is_less_and_without_it_is_no_more_than_before(wind):
    before, ended = wind
    assert ended.fits["constant_body_force"].loss < 0.7 * before.loss
    assert ended.before.loss <= before.loss
    assert ended.before.model.effects == ()


@pytest.mark.slow
def test_what_a_bad_twin_gains_by_an_effect_is_the_twins_and_not_the_effects():
    """A twin that is too stiff is helped by anything that has its other numbers refitted."""
    stiff = replace(sheet(), stiffness=5.0 * sheet().stiffness)
    before, ended = selected(stiff, episodes(), "viscoelasticity", ("quadratic_drag",))
    apparent = before.loss - ended.fits["viscoelasticity"].loss
    assert apparent > 30.0
    assert ended.before.loss - ended.fits["viscoelasticity"].loss < 0.2 * apparent


def test_without_a_table_a_tilted_frame_is_refitted_where_tilted_gravity_explains_much():
    moved = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=140))
    body = marker_body(moved, None)
    cable = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=1.0)
    tilted = with_effect(cable, "gravity_tilt", {"about_x": 0.2, "about_y": 0.0})
    seen = replace(moved, points=rolled_out(tilted, body, moved))
    before, ended = selected_in(
        [observe_markers(twin_of(body, cable), seen)],
        cable,
        baseline_parameters(cable),
        "constant_body_force",
        ("gravity_tilt", "tracking_rotation"),
    )
    gains = {name: before.loss - fitted.loss for name, fitted in ended.fits.items()}
    assert gains["gravity_tilt"] > 50.0
    assert gains["tracking_rotation"] == pytest.approx(gains["gravity_tilt"], rel=0.1)
