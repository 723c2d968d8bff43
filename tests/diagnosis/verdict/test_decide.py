"""The verdict: what is named, what is not told apart, and what is not claimed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from egophys_core.diagnosis.diagnosis import Estimate, NearestMiss, Outcome
from egophys_core.diagnosis.evidence.judging import RefittedEffect
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.verdict import decide as verdict_module
from egophys_core.diagnosis.verdict.decide import Verdict
from tests.simulation.scenes import sheet_model

TILT = {axis: Estimate(value=0.1, unit="rad", ci95=(0.05, 0.15)) for axis in ("about_x", "about_y")}
"""Parameters of a clear tilt: their intervals leave out 0."""


THRESHOLDS = Thresholds(
    least_gain=50.0,
    crowded_gain=60.0,
    crowd_share=0.5,
    unpenalised_parameters=2,
    parameter_gain=5.0,
    second_gain=80.0,
    unvalidated_gain=90.0,
    episodes_in_turn=3,
    in_turn_gain=75.0,
    remaining_share=0.2,
    harm_share=0.2,
    largest_p=0.05,
    supported_share=0.1,
    supporting_gain=15.0,
    overwhelming_gain=400.0,
    validation_share=0.5,
    equal_share=0.9,
    rival_share=0.75,
    special_case_share=0.4,
    floor_m=0.002,
    left_share=0.7,
    structure_gain=70.0,
    others_share=0.4,
)
"""Of these tests: whatever those of the project are, the criteria have to work."""

CLEAR = 150.0
"""A gain that is beyond all of them."""


def decide(
    candidates: list[RefittedEffect], surrogate_shares: dict[str, float], law_gain: float, episodes: int, **more
) -> Verdict:
    """The verdict by the thresholds of these tests."""
    return verdict_module.decide(candidates, surrogate_shares, law_gain, episodes, thresholds=THRESHOLDS, **more)


def judged(name: str, gain: float, **changes) -> RefittedEffect:
    """An effect that passes all tests if its gain is large."""
    numbers = {
        "quadratic_drag": {"coefficient": 3.0},
        "control_delay": {"delay": 0.05},
        "anisotropy": {"cosine": 0.2, "sine": 0.1},
        "viscoelasticity": {"ratio": 0.2, "time": 0.5},
    }[name]
    fields = {
        "name": name,
        "fitted": SimpleNamespace(),
        "problem": SimpleNamespace(),
        "left_m": 1e-3,
        "fitted_gain": gain,
        "held_out_gain": gain,
        "block_gains": np.full(20, gain / 20),
        "gain_ci95": (0.5 * gain, 1.5 * gain),
        "episode_gains": np.array([gain / 2, gain / 2]),
        "validation_gains": np.array([gain / 2]),
        "parameters": {
            key: Estimate(value=value, unit="1", ci95=(0.5 * value, 2 * value)) for key, value in numbers.items()
        },
        "episodes_agree": True,
    }
    return RefittedEffect(**{**fields, **changes})


P = {"quadratic_drag": 0.01, "control_delay": 0.01, "anisotropy": 0.01}
REFUTED = {"episodes_agree": False, "episode_gains": np.array([60.0, -50.0])}


def test_one_clear_effect_is_named():
    verdict = decide([judged("control_delay", 5.0), judged("quadratic_drag", CLEAR)], P, 10.0, 2)
    assert verdict.outcome == Outcome.NAMED
    assert [each.name for each in verdict.named] == ["quadratic_drag"]


def test_beside_others_that_gain_alike_more_is_asked_for():
    gain = 55.0
    alone = decide([judged("control_delay", gain)], P, 0.0, 2)
    crowded = decide([judged("control_delay", gain), judged("anisotropy", 0.7 * gain)], P, 0.0, 2)
    assert (alone.outcome, crowded.outcome) == (Outcome.NAMED, Outcome.NONE)


def test_what_episodes_that_were_not_fitted_speak_against_is_not_named():
    validated, disproven = (
        [judged("quadratic_drag", CLEAR, validation_gains=np.array(gains))] for gains in ([40, -20], [20, -40])
    )
    assert decide(validated, P, 0.0, 2).outcome == Outcome.NAMED
    assert decide(disproven, P, 0.0, 2).outcome == Outcome.NONE


def test_without_such_episodes_more_is_asked_for_or_another_motion():
    little, enough = (
        decide([judged("quadratic_drag", factor * 90.0, validation_gains=np.zeros(0))], P, 0.0, 2)
        for factor in (0.9, 1.1)
    )
    assert (little.outcome, enough.outcome) == (Outcome.UNEXPLAINED, Outcome.NAMED)
    assert enough.experiment is None
    assert "record one more motion" in little.experiment


def test_three_motions_that_each_gain_when_left_out_come_near_to_such_episodes():
    gain = 80.0
    every, most, two = (
        decide([judged("quadratic_drag", gain, validation_gains=np.zeros(0), episode_gains=np.array(gains))], P, 0.0, 3)
        for gains in ([40.0, 20.0, 20.0], [60.0, 30.0, -10.0], [40.0, 40.0])
    )
    assert [each.outcome for each in (every, most, two)] == [Outcome.NAMED, *2 * [Outcome.UNEXPLAINED]]


def test_a_large_gain_in_them_is_enough_whatever_an_effect_gains_elsewhere():
    little, enough = ([judged("quadratic_drag", 300.0, validation_gains=np.array([gain]))] for gain in (13.5, 16.5))
    assert decide(little, P, 0.0, 2).outcome != Outcome.NAMED
    assert decide(enough, P, 0.0, 2).outcome == Outcome.NAMED


@pytest.mark.parametrize(
    ("gain", "there", "named"), [(390.0, 13.0, False), (410.0, 13.0, True), (410.0, -13.0, True), (410.0, -16.0, False)]
)
def test_what_gains_overwhelmingly_must_only_not_lose_there(gain, there, named):
    verdict = decide([judged("quadratic_drag", gain, validation_gains=np.array([there]))], P, 0.0, 2)
    assert (verdict.outcome == Outcome.NAMED) == named


def test_what_they_support_in_full_need_not_show_in_each_that_was_fitted():
    lost = {"episode_gains": np.array([10.0, -2 * CLEAR]), "episodes_agree": False}
    some, all_of_it = (
        [judged("quadratic_drag", CLEAR, validation_gains=np.array([share * CLEAR]), **lost)] for share in (0.9, 1.0)
    )
    assert decide(some, P, 0.0, 2).outcome == Outcome.UNEXPLAINED
    assert decide(all_of_it, P, 0.0, 2).outcome == Outcome.NAMED


def test_a_rival_that_they_speak_against_leaves_nothing_ambiguous():
    effects = [
        judged("quadratic_drag", CLEAR, validation_gains=np.array([20.0])),
        judged("control_delay", 1.1 * CLEAR, validation_gains=np.array([-20.0])),
    ]
    verdict = decide(effects, P, 0.0, 2)
    assert (verdict.outcome, [each.name for each in verdict.named]) == (Outcome.NAMED, ["quadratic_drag"])


def test_large_residuals_are_unexplained_where_no_effect_is_named():
    outcomes = [decide(each, P, 0.0, 2, residual_m=0.004).outcome for each in ([judged("quadratic_drag", CLEAR)], [])]
    assert outcomes == [Outcome.NAMED, Outcome.UNEXPLAINED]


def added_mass(x: float, z: float) -> RefittedEffect:
    """In a sheet, clear, at a place from its centre."""
    numbers = {"x": x, "y": 0.0, "z": z, "radius": 0.02, "fraction": 0.5}
    parameters = {name: Estimate(value=value, unit="1", ci95=(0.3, 0.8)) for name, value in numbers.items()}
    body = SimpleNamespace(model=sheet_model())
    return replace(judged("anisotropy", 2 * CLEAR), name="uneven_mass", parameters=parameters, fitted=body)


def test_an_added_mass_beside_the_object_is_none():
    half = np.ptp(sheet_model().graph.positions[:, 0]) / 2
    places = [(0.9 * half, 0.0), (0.9 * half, 1.0), (half + 0.1, 0.0)]
    outcomes = [decide([added_mass(*place)], {"uneven_mass": 0.01}, 0.0, 2).outcome for place in places]
    assert outcomes == [Outcome.NAMED, Outcome.NAMED, Outcome.UNEXPLAINED]


def test_an_effect_of_many_numbers_needs_more():
    gain = 51.0
    numbers = {name: Estimate(value=0.1, unit="1", ci95=(0.05, 0.2)) for name in ("x", "y", "z", "radius", "fraction")}
    body = SimpleNamespace(model=sheet_model())
    added_mass = replace(judged("anisotropy", gain), name="uneven_mass", parameters=numbers, fitted=body)
    assert decide([added_mass], {"uneven_mass": 0.01}, 0.0, 2).outcome == Outcome.NONE
    assert decide([judged("anisotropy", gain)], P, 0.0, 2).outcome == Outcome.NAMED


def test_a_second_effect_needs_more():
    gain = 70.0
    verdict = decide([judged("control_delay", gain)], P, 0.0, 2, beside_named=True)
    assert verdict.outcome == Outcome.NONE


def test_beside_an_effect_that_gains_much_a_second_one_needs_a_share_of_that():
    beside = replace(THRESHOLDS, second_share=0.3).beside(1000.0)
    assert (beside.second_gain, replace(THRESHOLDS, second_share=0.3).beside(10.0).second_gain) == (300.0, 80.0)
    verdicts = [
        verdict_module.decide([judged("control_delay", gain)], P, 0.0, 2, beside_named=True, thresholds=beside)
        for gain in (240.0, 360.0)
    ]
    assert [each.outcome for each in verdicts] == [Outcome.NONE, Outcome.NAMED]


@pytest.mark.parametrize(
    ("shares", "outcome"),
    [
        ([0.6, 1.2], Outcome.NAMED),
        ([0.8, 1.0, 0.9, 2.2], Outcome.UNEXPLAINED),
        ([np.nan, 0.5], Outcome.UNEXPLAINED),
        ([0.0, 1.0], Outcome.NAMED),
    ],
    ids=["better in the mean", "worse in the mean", "both diverge", "diverges without it"],
)
def test_with_a_second_effect_free_rollouts_must_be_better(shares, outcome):
    second = judged("control_delay", CLEAR, shares_left=np.array(shares))
    verdict = decide([second], P, 0.0, 2, beside_named=True)
    assert verdict.outcome == outcome
    assert (failed(verdict, "control_delay") == ["predicts"]) == (outcome == Outcome.UNEXPLAINED)


@pytest.mark.parametrize(
    ("gains", "outcome"),
    [
        (None, Outcome.NAMED),
        ([], Outcome.NAMED),
        ([0.9 * CLEAR, 0.6 * CLEAR], Outcome.NAMED),
        ([0.9 * CLEAR, 0.1 * CLEAR], Outcome.NONE),
        ([-20.0, -5.0], Outcome.NONE),
    ],
    ids=["not asked", "one graph alone", "beside both", "beside one", "beside none"],
)
def test_what_helps_only_one_way_to_make_the_twin_is_neither_named_nor_structure(gains, outcome):
    candidate = judged("quadratic_drag", CLEAR, gains_beside_others=None if gains is None else np.array(gains))
    verdict = decide([candidate], P, 0.0, 2)
    assert verdict.outcome == outcome
    assert failed(verdict, "quadratic_drag") == ([] if outcome == Outcome.NAMED else ["other_twins"])


@pytest.mark.parametrize(("share", "outcome"), [(0.9, Outcome.AMBIGUOUS), (0.1, Outcome.NAMED)])
def test_what_helps_only_one_way_to_make_the_twin_is_no_rival(share, outcome):
    rival = judged("quadratic_drag", 1.1 * CLEAR, gains_beside_others=np.full(2, share * CLEAR))
    verdict = decide([judged("control_delay", CLEAR), rival], P, 0.0, 2)
    assert verdict.outcome == outcome
    assert verdict.named[-1].name == "control_delay"


@pytest.mark.parametrize(
    ("second", "outcome"), [(False, Outcome.NAMED), (True, Outcome.UNEXPLAINED)], ids=["alone", "beside another"]
)
def test_a_second_effect_must_help_in_every_episode(second, outcome):
    one_sided = judged("control_delay", 160.0, episode_gains=np.array([240.0, -8.0]))
    assert decide([one_sided], P, 0.0, 2, beside_named=second).outcome == outcome


def test_little_gain_is_no_effect():
    verdict = decide([judged("quadratic_drag", 25.0)], P, 0.0, 2)
    assert (verdict.outcome, verdict.named) == (Outcome.NONE, ())


@pytest.mark.parametrize(
    "flaw",
    [
        {"gain_ci95": (-1.0, CLEAR)},
        {"episode_gains": np.array([5.0, -60.0])},
        {"parameters": {"coefficient": Estimate(value=60.0, unit="1/m", ci95=(50.0, 70.0))}},
        {"parameters": {"coefficient": Estimate(value=0.1, unit="1/m", ci95=(-0.1, 0.3))}},
        {"fitted_gain": 0.0},
        {"episodes_agree": False, "episode_gains": np.array([60.0, -50.0])},
    ],
)
def test_an_effect_with_a_flaw_is_not_named(flaw):
    verdict = decide([replace(judged("quadratic_drag", CLEAR), **flaw)], P, 0.0, 2)
    assert verdict.outcome in (Outcome.NONE, Outcome.UNEXPLAINED)
    assert not verdict.named


@pytest.mark.parametrize("gains", [(0.5, 0.5), (0.9, -0.1)])
def test_sizes_that_differ_but_do_no_harm_in_the_other_episode_are_forgiven(gains):
    """In an episode of slow motion drag shows little."""
    found = judged("quadratic_drag", CLEAR, episodes_agree=False, episode_gains=CLEAR * np.array(gains))
    assert decide([found], P, 0.0, 2).outcome == Outcome.NAMED


def test_surrogates_that_gain_as_much_forbid_a_name():
    """And they are no structure either."""
    assert decide([judged("quadratic_drag", CLEAR)], {"quadratic_drag": 0.3}, 0.0, 2).outcome == Outcome.NONE


def test_two_that_gain_alike_are_ambiguous_with_an_experiment():
    verdict = decide([judged("quadratic_drag", CLEAR), judged("control_delay", 0.95 * CLEAR)], P, 0.0, 2)
    assert verdict.outcome == Outcome.AMBIGUOUS
    assert [each.name for each in verdict.named] == ["quadratic_drag", "control_delay"]
    assert "swing" in verdict.experiment


def test_of_two_that_gain_alike_the_one_that_validation_episodes_support_is_named():
    found = [judged("quadratic_drag", CLEAR), judged("control_delay", 0.95 * CLEAR)]
    validation = (np.array([0.5 * CLEAR]), np.array([0.12 * CLEAR]))
    verdict = decide(
        [replace(each, validation_gains=gain) for each, gain in zip(found, validation, strict=True)], P, 0.0, 2
    )
    assert (verdict.outcome, [each.name for each in verdict.named]) == (Outcome.NAMED, ["quadratic_drag"])


def test_of_two_that_gain_alike_the_one_that_is_the_same_in_every_episode_is_named():
    same, another = judged("quadratic_drag", 1.02 * CLEAR), judged("control_delay", CLEAR, episodes_agree=False)
    assert [each.name for each in decide([same, another], P, 0.0, 2).named] == ["quadratic_drag"]
    both_differ = [replace(same, episodes_agree=False), another]
    assert decide(both_differ, P, 0.0, 2).outcome == Outcome.AMBIGUOUS
    # The one that gains most has to be the same, too.
    ahead = judged("control_delay", 1.1 * CLEAR, episodes_agree=False)
    assert decide([ahead, same], P, 0.0, 2).outcome == Outcome.AMBIGUOUS


def test_what_a_refuted_effect_explains_as_well_is_no_evidence():
    refuted = judged("control_delay", 1.1 * CLEAR, **REFUTED)
    verdict = decide([judged("quadratic_drag", CLEAR), refuted], P, 0.0, 2)
    assert (verdict.outcome, verdict.named) == (Outcome.UNEXPLAINED, ())
    assert "control_delay" in verdict.reason


def test_what_a_refuted_effect_explains_as_well_is_mismatch_while_it_is_little():
    gain = 65.0
    verdict = decide([judged("quadratic_drag", gain), judged("control_delay", gain, **REFUTED)], P, 0.0, 2)
    assert verdict.outcome == Outcome.NONE


def test_a_refuted_special_case_does_not_refute_the_general_one():
    upward = {"x": 1.0, "y": 1.0, "z": 2.0}
    force = {axis: Estimate(value=value, unit="m/s^2", ci95=(0.5, 2.5)) for axis, value in upward.items()}
    towel = SimpleNamespace(model=sheet_model())
    general = replace(judged("quadratic_drag", CLEAR), name="constant_body_force", parameters=force, fitted=towel)
    special = replace(general, name="gravity_tilt", parameters=TILT, **REFUTED)
    verdict = decide([general, special], {"constant_body_force": 0.01, "gravity_tilt": 0.01}, 0.0, 2)
    assert [each.name for each in verdict.named] == ["constant_body_force"]


def attraction_and_scale(excess: float) -> list[RefittedEffect]:
    """Attraction to a point, which gains so much more than what it contains, another scale of gravity."""
    towel = SimpleNamespace(model=sheet_model())
    numbers = {name: Estimate(value=0.5, unit="1", ci95=(0.4, 0.6)) for name in ("x", "y", "z", "strength", "range")}
    scale = {"scale": Estimate(value=0.6, unit="1", ci95=(0.5, 0.7))}
    found = judged("quadratic_drag", CLEAR)
    general = judged("quadratic_drag", CLEAR + excess)
    return [
        replace(general, name="point_attraction", parameters=numbers, fitted=towel),
        replace(found, name="gravity_scale", parameters=scale, fitted=towel),
    ]


@pytest.mark.parametrize(("excess", "named"), [(0.05 * CLEAR, "gravity_scale"), (0.5 * CLEAR, "point_attraction")])
def test_a_general_effect_is_named_only_if_it_explains_clearly_more_than_its_special_case(excess, named):
    verdict = decide(attraction_and_scale(excess), {"point_attraction": 0.01, "gravity_scale": 0.01}, 0.0, 2)
    assert (verdict.outcome, [each.name for each in verdict.named]) == (Outcome.NAMED, [named])


@pytest.mark.parametrize("flaw", [{}, REFUTED])
def test_a_tilt_and_a_horizontal_force_go_together_even_if_one_refit_ended_lower(flaw):
    towel = SimpleNamespace(model=sheet_model())
    force = {axis: Estimate(value=1.0, unit="m/s^2", ci95=(0.5, 1.5)) for axis in "xyz"}
    found = [
        replace(judged("quadratic_drag", gain, **flaws), name=name, parameters=numbers, fitted=towel)
        for name, gain, numbers, flaws in (
            ("constant_body_force", CLEAR, force, {}),
            ("gravity_tilt", 0.4 * CLEAR, TILT, flaw),
        )
    ]
    verdict = decide(found, {"constant_body_force": 0.01, "gravity_tilt": 0.01}, 0.0, 2)
    assert verdict.outcome == Outcome.AMBIGUOUS
    assert [each.name for each in verdict.named] == ["constant_body_force", "gravity_tilt"]


def test_a_tilt_is_not_named_alone_where_the_library_has_no_force():
    verdict = decide(
        [replace(judged("quadratic_drag", CLEAR), name="gravity_tilt", parameters=TILT)], {"gravity_tilt": 0.01}, 0.0, 2
    )
    assert verdict.outcome == Outcome.AMBIGUOUS
    assert "constant_body_force" in verdict.reason


@pytest.mark.parametrize("steady", [True, False])
def test_a_lead_that_lasts_over_the_blocks_is_clear_and_one_block_is_not(steady):
    gain = 0.8 * CLEAR
    lead = np.full(20, 0.01 * CLEAR) if steady else np.eye(20)[0] * 0.2 * CLEAR
    best = judged("quadratic_drag", CLEAR, block_gains=gain / 20 + lead)
    verdict = decide([best, judged("control_delay", gain)], P, 0.0, 2)
    assert verdict.outcome == (Outcome.NAMED if steady else Outcome.AMBIGUOUS)


@pytest.mark.parametrize(
    ("up", "kind", "named"), [(2.6, "solid", 0), (0.5, "solid", 1), (2.6, "sheet", 1), (2.6, "rod", 1)]
)
def test_a_toy_alone_may_deflect_less_than_its_twin_without_a_force_upward(up, kind, named):
    force = {
        axis: Estimate(value=value, unit="m/s^2", ci95=(0.9 * value, 1.1 * value))
        for axis, value in {"x": 0.8, "y": 0.1, "z": up}.items()
    }
    body = SimpleNamespace(model=replace(sheet_model(), kind=kind))
    found = replace(judged("quadratic_drag", CLEAR), name="constant_body_force", parameters=force, fitted=body)
    assert len(decide([found], {"constant_body_force": 0.01}, 0.0, 2).named) == named


@pytest.mark.parametrize(("without_m", "named"), [(0.004, ["quadratic_drag"]), (0.002, ["control_delay"])])
def test_what_leaves_most_of_what_a_free_rollout_misses_does_not_explain_it(without_m, named):
    found = [
        judged("quadratic_drag", CLEAR, left_m=0.6 * without_m),
        judged("control_delay", 2 * CLEAR, left_m=0.8 * without_m),
    ]
    verdict = decide(found, P, 0.0, 2, free_residual_m=without_m)
    assert [each.name for each in verdict.named] == named


def test_one_episode_names_nothing_and_says_what_to_record():
    verdict = decide([judged("quadratic_drag", CLEAR)], P, 0.0, 1)
    assert verdict.outcome == Outcome.AMBIGUOUS
    assert "second episode" in verdict.experiment


def test_one_episode_without_any_effect_says_what_to_record_too():
    verdict = decide([judged("quadratic_drag", 25.0)], P, 0.0, 1)
    assert (verdict.outcome, verdict.named) == (Outcome.NONE, ())
    assert "one motion" in verdict.reason
    assert "second motion" in verdict.experiment


def test_structure_that_nothing_fits_is_unexplained():
    verdict = decide([judged("quadratic_drag", 1.0)], P, 140.0, 2)
    assert (verdict.outcome, verdict.named) == (Outcome.UNEXPLAINED, ())


@pytest.mark.parametrize(("time", "outcome"), [(0.5, Outcome.NAMED), (0.03, Outcome.UNEXPLAINED)])
def test_what_relaxes_at_once_is_damping(time: float, outcome: Outcome) -> None:
    numbers = {"ratio": 0.5, "time": time}
    relaxes = judged(
        "viscoelasticity",
        CLEAR,
        parameters={
            key: Estimate(value=value, unit="1", ci95=(0.9 * value, 1.1 * value)) for key, value in numbers.items()
        },
    )
    verdict = decide([relaxes], {"viscoelasticity": 0.01}, 0.0, 2, beside_named=False)
    assert verdict.outcome == outcome


def failed(verdict: Verdict, name: str) -> list[str]:
    """The criteria that a candidate failed."""
    return [each.name for each in verdict.criteria[name] if not each.passed]


@pytest.mark.parametrize(
    ("flaw", "criterion"),
    [
        ({"fitted_gain": 40.0}, "held_out_gain"),
        ({"gain_ci95": (-1.0, CLEAR)}, "gain_interval"),
        ({"validation_gains": np.array([-1.0])}, "validation"),
        ({"parameters": {"coefficient": Estimate(value=0.1, unit="1/m", ci95=(-0.1, 0.3))}}, "differs_from_none"),
        ({"parameters": {"coefficient": Estimate(value=60.0, unit="1/m", ci95=(50.0, 70.0))}}, "within_bounds"),
        ({"episode_gains": np.array([5.0, 10.0])}, "left_out_episodes"),
        ({"episodes_agree": False, "episode_gains": np.array([100.0, -50.0])}, "same_size"),
        ({"left_m": 0.01}, "explains_free_rollouts"),
    ],
)
def test_the_criterion_that_fails_is_named_with_its_numbers_and_no_other(flaw, criterion):
    verdict = decide([judged("quadratic_drag", CLEAR, **flaw)], P, 0.0, 2, free_residual_m=0.005)
    assert failed(verdict, "quadratic_drag") == [criterion]
    (result,) = (each for each in verdict.criteria["quadratic_drag"] if each.name == criterion)
    assert result.applied
    assert f"needs {result.direction}" in result.sentence


def test_a_candidate_that_passes_has_passed_every_criterion_that_was_asked():
    verdict = decide([judged("quadratic_drag", CLEAR)], P, 0.0, 2)
    results = {each.name: each for each in verdict.criteria["quadratic_drag"]}
    assert all(each.passed for each in results.values())
    gain = results["held_out_gain"]
    assert (gain.statistic, gain.threshold, gain.direction) == (CLEAR, 50.0, "at least")
    assert not results["every_episode"].applied


def test_the_gain_that_is_asked_for_says_why():
    five = added_mass(0.0, 0.0)
    alone = {each.name: each for each in decide([five], {"uneven_mass": 0.01}, 0.0, 2).criteria["uneven_mass"]}
    assert alone["held_out_gain"].threshold == 65.0
    assert "15 are for its 5 parameters" in alone["held_out_gain"].sentence
    crowd = [judged("control_delay", 55.0), judged("anisotropy", 40.0)]
    asked = {each.name: each for each in decide(crowd, P, 0.0, 2).criteria["control_delay"]}
    assert asked["held_out_gain"].threshold == 60.0
    assert "beside anisotropy" in asked["held_out_gain"].sentence


def test_why_none_is_the_first_criterion_of_the_nearest_miss():
    candidates = [
        judged("quadratic_drag", 45.0),
        judged("control_delay", 10.0, validation_gains=np.array([-5.0]), gain_ci95=(-9.0, 20.0)),
        judged("anisotropy", 20.0),
    ]
    verdict = decide(candidates, P, 0.0, 2)
    decision = verdict.decision
    assert (verdict.outcome, decision.rule, decision.candidate) == (
        Outcome.NONE,
        "no_candidate_passes",
        "quadratic_drag",
    )
    assert decision.criterion.sentence == "gain on left-out data 45, needs at least 50, as it stands alone"
    assert [each.candidate for each in decision.nearest_misses] == ["quadratic_drag", "anisotropy", "control_delay"]
    assert [each.name for each in decision.nearest_misses[2].failed] == ["held_out_gain", "gain_interval", "validation"]


@pytest.mark.parametrize(
    ("candidates", "more", "rule", "criterion"),
    [
        ([judged("quadratic_drag", CLEAR)], {}, "named", "held_out_gain"),
        ([judged("quadratic_drag", 5.0)], {"residual_m": 0.003}, "large_residual", "residual_size"),
        ([judged("quadratic_drag", 5.0)], {"law_gain": 71.0}, "unexplained_structure", "structure"),
        ([], {}, "no_candidate_passes", "structure"),
        (
            [judged("quadratic_drag", CLEAR), judged("control_delay", 1.1 * CLEAR, **REFUTED)],
            {},
            "refuted_rival",
            "told_apart",
        ),
        (
            [judged("quadratic_drag", CLEAR), judged("control_delay", CLEAR)],
            {},
            "indistinguishable_rivals",
            "told_apart",
        ),
        ([judged("quadratic_drag", CLEAR)], {"episodes": 1}, "one_motion_only", "motions"),
        (
            [replace(judged("quadratic_drag", CLEAR), name="gravity_tilt", parameters=TILT)],
            {},
            "equivalent_effect",
            "has_no_equivalent",
        ),
    ],
)
def test_each_rule_says_which_criterion_decided(candidates, more, rule, criterion):
    arguments = {"law_gain": 0.0, "episodes": 2, **more}
    verdict = decide(candidates, {**P, "gravity_tilt": 0.01}, **arguments)
    assert (verdict.decision.rule, verdict.decision.criterion.name) == (rule, criterion)
    assert verdict.decision.criterion.passed == (rule in ("named",) or not candidates)
    assert bool(verdict.decision.nearest_misses) == (bool(failed_any(verdict)) and not verdict.named)


def failed_any(verdict: Verdict) -> list[str]:
    return [name for name in verdict.criteria if failed(verdict, name)]


def test_what_was_only_ranked_comes_after_what_was_refitted_and_three_are_listed():
    decision = decide([judged("quadratic_drag", 45.0), judged("anisotropy", 20.0)], P, 0.0, 2).decision
    others = [NearestMiss(candidate=name, failed=decision.nearest_misses[0].failed) for name in ("one", "another")]
    listed = [each.candidate for each in decision.with_further_misses(others).nearest_misses]
    assert listed == ["quadratic_drag", "anisotropy", "one"]
