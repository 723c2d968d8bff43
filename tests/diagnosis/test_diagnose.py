"""Diagnoses from end to end, on a small sheet of our own simulator: recovery, nulls, too little data."""

import json
from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.diagnose import diagnose
from egophys_core.diagnosis.diagnosis import Outcome
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.saving import save_finding
from egophys_core.effects import LIBRARY
from egophys_core.errors import DiscrepancyError, EpisodeError, TwinError
from egophys_core.twin import load_twin
from egophys_core.twin.parameters import GRAVITY
from tests.diagnosis.direct.test_measure import fine_sheet, measured_episodes
from tests.diagnosis.rehearsed import WIND, episodes, fallen, sheet
from tests.identification.synthetic import episode_of, make_episode
from tests.twin.examples import make_twin

QUICK = DiagnosisOptions(baseline_starts=2, shortlist=2, refit_iterations=3, surrogates=40, bootstraps=100)

ASKED = {"constant_body_force", "gravity_tilt", "quadratic_drag"}
"""Effects, of which two explain a wind: each further one costs these tests ten seconds."""

OF_ALL_SORTS = {"quadratic_drag", "anisotropy", "gripper_offset", "stribeck_friction", "uneven_mass"}
"""Effects on what acts on an object, on its material, on how it is held and what it slides on."""


@pytest.fixture(scope="module")
def wind(tmp_path_factory):
    """The diagnosis of a steady wind from three episodes, and the folder it was saved in."""
    away = make_episode(replace(sheet(), effects=(WIND,)), name="away", duration=3.2, carry=(-0.1, -0.1, 0.2))
    finding = diagnose(make_twin(sheet()), [*episodes(WIND), away], QUICK, without=LIBRARY.keys() - ASKED)
    folder = tmp_path_factory.mktemp("wind") / "out"
    save_finding(finding, folder)
    return finding, folder


def test_a_steady_sideways_wind_is_not_told_from_tilted_gravity(wind):
    """They are the same force on every node; what is found of it is the same as well."""
    diagnosis = wind[0].diagnosis
    assert diagnosis.outcome == Outcome.AMBIGUOUS
    effects = {effect.name: effect.parameters for effect in diagnosis.effects}
    assert {"constant_body_force", "gravity_tilt"} <= set(effects) & set(diagnosis.ambiguous)
    force, tilt = effects["constant_body_force"], effects["gravity_tilt"]
    assert [force["x"].value, force["y"].value] == pytest.approx([1.5, -1.0], abs=0.5)
    assert [-GRAVITY * tilt["about_y"].value, GRAVITY * tilt["about_x"].value] == pytest.approx([1.5, -1.0], abs=0.6)
    assert diagnosis.experiment


def test_of_three_episodes_the_last_is_not_fitted_and_supports_the_effect(wind):
    diagnosis = wind[0].diagnosis
    assert [error.fitted for error in diagnosis.error] == [True, True, False]
    validation = {each.name: each.validation_gain for each in diagnosis.candidates}
    assert validation["constant_body_force"] > 20.0
    assert None in validation.values()


def test_the_best_of_what_is_named_was_asked_beside_other_twins(wind):
    diagnosis = wind[0].diagnosis
    (best,) = [each for each in diagnosis.candidates if each.name == diagnosis.effects[0].name]
    (asked,) = [each for each in best.criteria if each.name == "other_twins"]
    assert asked.applied
    assert asked.passed


def test_the_improved_twin_predicts_better_and_names_its_parent(wind):
    finding, folder = wind
    for error in finding.diagnosis.error:
        assert error.track_after_m < 0.7 * error.track_before_m
    twin = load_twin(folder / "improved.twin")
    assert twin.provenance.parent_id == finding.diagnosis.twin_id
    assert twin.twin_id == finding.diagnosis.improved_twin_id
    assert [effect.name for effect in twin.model.effects] == [finding.diagnosis.effects[0].name]


def test_the_file_has_the_keys_that_users_read(wind):
    content = json.loads((wind[1] / "diagnosis.json").read_text())
    assert {"outcome", "effects", "candidates", "experiment", "where", "error", "seconds"} <= set(content)
    for estimate in content["effects"][0]["parameters"].values():
        assert estimate["ci95"][0] <= estimate["value"] <= estimate["ci95"][1]
    (decision,) = content["decisions"]
    assert decision["rule"] == "indistinguishable_rivals"
    assert not decision["criterion"]["passed"]
    for candidate in content["candidates"]:
        assert {"name", "sentence", "statistic", "threshold", "unit", "applied", "passed"} <= set(
            candidate["criteria"][0]
        )
    gains = [each["held_out_gain"] for each in content["candidates"]]
    assert gains == sorted(gains, reverse=True)


def test_nothing_injected_nothing_named():
    diagnosis = diagnose(make_twin(sheet()), episodes(), QUICK, without=LIBRARY.keys() - OF_ALL_SORTS).diagnosis
    assert (diagnosis.outcome, diagnosis.effects) == (Outcome.NONE, ())
    (decision,) = diagnosis.decisions
    assert decision.rule == "no_candidate_passes"
    assert len(decision.nearest_misses) == 3
    for candidate in diagnosis.candidates:
        assert not all(each.passed for each in candidate.criteria)


@pytest.mark.slow
def test_of_the_whole_library_nothing_is_named_where_nothing_is_injected():
    diagnosis = diagnose(make_twin(sheet()), episodes(), QUICK).diagnosis
    assert (diagnosis.outcome, diagnosis.effects) == (Outcome.NONE, ())


def test_an_episode_that_the_twin_does_not_follow_supports_nothing():
    recorded = [*episodes(), fallen()]
    diagnosis = diagnose(make_twin(sheet()), recorded, QUICK, without=LIBRARY.keys() - ASKED).diagnosis
    assert "does not follow fallen" in diagnosis.reason
    assert [each.validation_gain for each in diagnosis.candidates] == [None] * len(ASKED)


@pytest.mark.slow
def test_of_the_whole_library_nothing_but_a_steady_force_explains_a_wind():
    diagnosis = diagnose(make_twin(sheet()), episodes(WIND), QUICK).diagnosis
    assert {effect.name for effect in diagnosis.effects} == {"constant_body_force", "gravity_tilt"}


@pytest.mark.slow
def test_the_same_seed_gives_the_same_diagnosis():
    options = replace(QUICK, shortlist=1, refit_iterations=1)
    first, second = (diagnose(make_twin(sheet()), episodes(WIND), options, seed=3) for _ in range(2))
    assert first.twin.twin_id == second.twin.twin_id
    assert first.diagnosis.candidates == second.diagnosis.candidates


def test_no_episode_is_refused():
    with pytest.raises(DiscrepancyError, match="no episode given"):
        diagnose(make_twin(sheet()), [], QUICK)


def test_an_episode_given_twice_is_refused():
    episode = episodes()[0]
    with pytest.raises(DiscrepancyError, match="the same episode"):
        diagnose(make_twin(sheet()), [episode, episode], QUICK)


def test_no_motion_is_refused_with_what_is_missing():
    episode = episodes()[0]
    still = episode_of(np.repeat(episode.points[:1], 60, axis=0), np.repeat(episode.controllers[:1], 60, axis=0))
    with pytest.raises(EpisodeError, match=r"no hand moves the object.*egophys experiment TWIN"):
        diagnose(make_twin(sheet()), [still], QUICK)


def test_points_all_hidden_are_refused_with_what_is_missing():
    episode = episodes()[0]
    hidden = episode.points.copy()
    hidden[16:] = np.nan
    with pytest.raises((DiscrepancyError, EpisodeError)):
        diagnose(make_twin(sheet()), [episode_of(hidden, episode.controllers, episode.times)], QUICK)


def test_an_unknown_effect_to_leave_out_is_refused():
    with pytest.raises(TwinError, match="did you mean quadratic_drag"):
        diagnose(make_twin(sheet()), episodes(), QUICK, without=("quadratic_drug",))


@pytest.mark.slow
def test_a_name_taken_out_is_never_given():
    diagnosis = diagnose(make_twin(sheet()), episodes(WIND), QUICK, without=(WIND.name,)).diagnosis
    assert WIND.name not in [candidate.name for candidate in diagnosis.candidates]
    assert WIND.name not in [effect.name for effect in diagnosis.effects]


@pytest.mark.slow
def test_what_is_measured_directly_is_named_and_kept():
    finding = diagnose(make_twin(fine_sheet()), measured_episodes("control_delay"), QUICK)
    diagnosis = finding.diagnosis
    assert diagnosis.outcome == Outcome.NAMED, diagnosis.reason
    (delay,) = diagnosis.effects
    assert delay.name == "control_delay"
    assert delay.parameters["delay"].value == pytest.approx(0.1, abs=0.005)
    assert delay.parameters["delay"].value == finding.twin.model.effects[0].values["delay"]
    assert delay.name in [each.name for each in diagnosis.candidates]
    # The swing crumples whatever the delay is.
    before, after = (
        sum(getattr(each, name) for each in diagnosis.error) for name in ("track_before_m", "track_after_m")
    )
    assert after < 0.7 * before
