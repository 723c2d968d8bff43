"""The verdict: what is named, what is not told apart, and what is not claimed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from egophys_core.diagnosis.diagnosis import Estimate, Outcome
from egophys_core.diagnosis.evidence.judging import Judged
from egophys_core.diagnosis.verdict.decide import (
    ANOTHER_MOTION,
    BY_TURNS_GAIN,
    CROWDED_GAIN,
    FLOOR_M,
    LEAST_GAIN,
    PROOF_GAIN,
    SECOND_GAIN,
    STRUCTURE_GAIN,
    UNPROVEN_GAIN,
    decide,
    explaining,
)
from tests.simulation.scenes import sheet_model

TILT = {axis: Estimate(value=0.1, unit="rad", ci95=(0.05, 0.15)) for axis in ("about_x", "about_y")}
"""Parameters of a clear tilt: their intervals leave out 0."""


def judged(name: str, gain: float, **changes) -> Judged:
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
        "proof_gains": np.array([gain / 2]),
        "parameters": {
            key: Estimate(value=value, unit="1", ci95=(0.5 * value, 2 * value)) for key, value in numbers.items()
        },
        "episodes_agree": True,
    }
    return Judged(**{**fields, **changes})


P = {"quadratic_drag": 0.01, "control_delay": 0.01, "anisotropy": 0.01}
CLEAR = 3 * LEAST_GAIN
REFUTED = {"episodes_agree": False, "episode_gains": np.array([60.0, -50.0])}


def test_one_clear_effect_is_named():
    verdict = decide([judged("control_delay", 5.0), judged("quadratic_drag", CLEAR)], P, 10.0, 2)
    assert verdict.outcome == Outcome.NAMED
    assert [each.name for each in verdict.judged] == ["quadratic_drag"]


def test_beside_others_that_gain_alike_more_is_asked_for():
    gain = 0.5 * (LEAST_GAIN + CROWDED_GAIN)
    alone = decide([judged("control_delay", gain)], P, 0.0, 2)
    crowded = decide([judged("control_delay", gain), judged("anisotropy", 0.7 * gain)], P, 0.0, 2)
    assert (alone.outcome, crowded.outcome) == (Outcome.NAMED, Outcome.NONE)


def test_what_episodes_that_were_not_fitted_speak_against_is_not_named():
    proven, disproven = (
        [judged("quadratic_drag", CLEAR, proof_gains=np.array(gains))] for gains in ([40, -20], [20, -40])
    )
    assert decide(proven, P, 0.0, 2).outcome == Outcome.NAMED
    assert decide(disproven, P, 0.0, 2).outcome == Outcome.NONE


def test_without_such_episodes_more_is_asked_for_or_another_motion():
    little, enough = (
        decide([judged("quadratic_drag", factor * UNPROVEN_GAIN, proof_gains=np.zeros(0))], P, 0.0, 2)
        for factor in (0.9, 1.1)
    )
    assert (little.outcome, enough.outcome) == (Outcome.UNEXPLAINED, Outcome.NAMED)
    assert (little.experiment, enough.experiment) == (ANOTHER_MOTION, None)


def test_three_motions_that_each_gain_when_left_out_come_near_to_such_episodes():
    gain = 0.5 * (BY_TURNS_GAIN + UNPROVEN_GAIN)
    every, most, two = (
        decide([judged("quadratic_drag", gain, proof_gains=np.zeros(0), episode_gains=np.array(gains))], P, 0.0, 3)
        for gains in ([40.0, 20.0, 20.0], [60.0, 30.0, -10.0], [40.0, 40.0])
    )
    assert [each.outcome for each in (every, most, two)] == [Outcome.NAMED, *2 * [Outcome.UNEXPLAINED]]


def test_a_large_gain_in_them_is_enough_whatever_an_effect_gains_elsewhere():
    little, enough = (
        [judged("quadratic_drag", 20 * PROOF_GAIN, proof_gains=np.array([gain]))]
        for gain in (0.9 * PROOF_GAIN, 1.1 * PROOF_GAIN)
    )
    assert decide(little, P, 0.0, 2).outcome != Outcome.NAMED
    assert decide(enough, P, 0.0, 2).outcome == Outcome.NAMED


def test_what_they_bear_out_in_full_need_not_show_in_each_that_was_fitted():
    lost = {"episode_gains": np.array([10.0, -2 * CLEAR]), "episodes_agree": False}
    some, all_of_it = (
        [judged("quadratic_drag", CLEAR, proof_gains=np.array([share * CLEAR]), **lost)] for share in (0.9, 1.0)
    )
    assert decide(some, P, 0.0, 2).outcome == Outcome.UNEXPLAINED
    assert decide(all_of_it, P, 0.0, 2).outcome == Outcome.NAMED


def test_a_rival_that_they_speak_against_leaves_nothing_ambiguous():
    effects = [
        judged("quadratic_drag", CLEAR, proof_gains=np.array([20.0])),
        judged("control_delay", 1.1 * CLEAR, proof_gains=np.array([-20.0])),
    ]
    verdict = decide(effects, P, 0.0, 2)
    assert (verdict.outcome, [each.name for each in verdict.judged]) == (Outcome.NAMED, ["quadratic_drag"])


def test_large_residuals_are_unexplained_where_no_effect_is_named():
    outcomes = [
        decide(each, P, 0.0, 2, residual_m=2 * FLOOR_M).outcome for each in ([judged("quadratic_drag", CLEAR)], [])
    ]
    assert outcomes == [Outcome.NAMED, Outcome.UNEXPLAINED]


def lump(x: float, z: float) -> Judged:
    """In a sheet, clear, at a place from its centre."""
    numbers = {"x": x, "y": 0.0, "z": z, "radius": 0.02, "fraction": 0.5}
    parameters = {name: Estimate(value=value, unit="1", ci95=(0.3, 0.8)) for name, value in numbers.items()}
    body = SimpleNamespace(model=sheet_model())
    return replace(judged("anisotropy", 2 * CLEAR), name="uneven_mass", parameters=parameters, fitted=body)


def test_a_lump_beside_the_object_is_none():
    half = np.ptp(sheet_model().graph.positions[:, 0]) / 2
    places = [(0.9 * half, 0.0), (0.9 * half, 1.0), (half + 0.1, 0.0)]
    outcomes = [decide([lump(*place)], {"uneven_mass": 0.01}, 0.0, 2).outcome for place in places]
    assert outcomes == [Outcome.NAMED, Outcome.NAMED, Outcome.UNEXPLAINED]


def test_an_effect_of_many_numbers_needs_more():
    gain = LEAST_GAIN + 1.0
    numbers = {name: Estimate(value=0.1, unit="1", ci95=(0.05, 0.2)) for name in ("x", "y", "z", "radius", "fraction")}
    body = SimpleNamespace(model=sheet_model())
    lump = replace(judged("anisotropy", gain), name="uneven_mass", parameters=numbers, fitted=body)
    assert decide([lump], {"uneven_mass": 0.01}, 0.0, 2).outcome == Outcome.NONE
    assert decide([judged("anisotropy", gain)], P, 0.0, 2).outcome == Outcome.NAMED


def test_a_second_effect_needs_more():
    gain = 0.5 * (CROWDED_GAIN + SECOND_GAIN)
    verdict = decide([judged("control_delay", gain)], P, 0.0, 2, second=True)
    assert verdict.outcome == Outcome.NONE


@pytest.mark.parametrize(
    ("second", "outcome"), [(False, Outcome.NAMED), (True, Outcome.UNEXPLAINED)], ids=["alone", "beside another"]
)
def test_a_second_effect_must_help_in_every_episode(second, outcome):
    one_sided = judged("control_delay", 2 * SECOND_GAIN, episode_gains=np.array([3.0, -0.1]) * SECOND_GAIN)
    assert decide([one_sided], P, 0.0, 2, second=second).outcome == outcome


def test_little_gain_is_no_effect():
    verdict = decide([judged("quadratic_drag", 0.5 * LEAST_GAIN)], P, 0.0, 2)
    assert (verdict.outcome, verdict.judged) == (Outcome.NONE, ())


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
    assert not verdict.judged


@pytest.mark.parametrize("gains", [(0.5, 0.5), (0.9, -0.1)])
def test_sizes_that_differ_but_do_no_harm_in_the_other_episode_are_forgiven(gains):
    """In an episode of slow motion drag shows little."""
    found = judged("quadratic_drag", CLEAR, episodes_agree=False, episode_gains=CLEAR * np.array(gains))
    assert decide([found], P, 0.0, 2).outcome == Outcome.NAMED


def test_shams_that_gain_as_much_forbid_a_name():
    """And they are no structure either."""
    assert decide([judged("quadratic_drag", CLEAR)], {"quadratic_drag": 0.3}, 0.0, 2).outcome == Outcome.NONE


def test_two_that_gain_alike_are_ambiguous_with_an_experiment():
    verdict = decide([judged("quadratic_drag", CLEAR), judged("control_delay", 0.95 * CLEAR)], P, 0.0, 2)
    assert verdict.outcome == Outcome.AMBIGUOUS
    assert [each.name for each in verdict.judged] == ["quadratic_drag", "control_delay"]
    assert "swing" in verdict.experiment


def test_of_two_that_gain_alike_the_one_that_unfitted_episodes_bear_out_is_named():
    found = [judged("quadratic_drag", CLEAR), judged("control_delay", 0.95 * CLEAR)]
    proofs = (np.array([0.5 * CLEAR]), np.array([0.12 * CLEAR]))
    verdict = decide([replace(each, proof_gains=gain) for each, gain in zip(found, proofs, strict=True)], P, 0.0, 2)
    assert (verdict.outcome, [each.name for each in verdict.judged]) == (Outcome.NAMED, ["quadratic_drag"])


def test_of_two_that_gain_alike_the_one_that_is_the_same_in_every_episode_is_named():
    same, another = judged("quadratic_drag", 1.02 * CLEAR), judged("control_delay", CLEAR, episodes_agree=False)
    assert [each.name for each in decide([same, another], P, 0.0, 2).judged] == ["quadratic_drag"]
    both_differ = [replace(same, episodes_agree=False), another]
    assert decide(both_differ, P, 0.0, 2).outcome == Outcome.AMBIGUOUS
    # The one that gains most has to be the same, too.
    ahead = judged("control_delay", 1.1 * CLEAR, episodes_agree=False)
    assert decide([ahead, same], P, 0.0, 2).outcome == Outcome.AMBIGUOUS


def test_what_a_refuted_effect_explains_as_well_is_no_evidence():
    refuted = judged("control_delay", 1.1 * CLEAR, **REFUTED)
    verdict = decide([judged("quadratic_drag", CLEAR), refuted], P, 0.0, 2)
    assert (verdict.outcome, verdict.judged) == (Outcome.UNEXPLAINED, ())
    assert "control_delay" in verdict.reason


def test_what_a_refuted_effect_explains_as_well_is_mismatch_while_it_is_little():
    gain = 0.5 * (CROWDED_GAIN + STRUCTURE_GAIN)
    verdict = decide([judged("quadratic_drag", gain), judged("control_delay", gain, **REFUTED)], P, 0.0, 2)
    assert verdict.outcome == Outcome.NONE


def test_a_refuted_special_case_does_not_refute_the_general_one():
    upward = {"x": 1.0, "y": 1.0, "z": 2.0}
    force = {axis: Estimate(value=value, unit="m/s^2", ci95=(0.5, 2.5)) for axis, value in upward.items()}
    towel = SimpleNamespace(model=sheet_model())
    general = replace(judged("quadratic_drag", CLEAR), name="constant_body_force", parameters=force, fitted=towel)
    special = replace(general, name="gravity_tilt", parameters=TILT, **REFUTED)
    verdict = decide([general, special], {"constant_body_force": 0.01, "gravity_tilt": 0.01}, 0.0, 2)
    assert [each.name for each in verdict.judged] == ["constant_body_force"]


def attraction_and_scale(excess: float) -> list[Judged]:
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
    assert (verdict.outcome, [each.name for each in verdict.judged]) == (Outcome.NAMED, [named])


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
    assert [each.name for each in verdict.judged] == ["constant_body_force", "gravity_tilt"]


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
def test_a_toy_alone_may_sag_less_than_its_twin_without_being_pulled_up(up, kind, named):
    force = {
        axis: Estimate(value=value, unit="m/s^2", ci95=(0.9 * value, 1.1 * value))
        for axis, value in {"x": 0.8, "y": 0.1, "z": up}.items()
    }
    body = SimpleNamespace(model=replace(sheet_model(), kind=kind))
    found = replace(judged("quadratic_drag", CLEAR), name="constant_body_force", parameters=force, fitted=body)
    assert len(decide([found], {"constant_body_force": 0.01}, 0.0, 2).judged) == named


def test_what_leaves_most_of_what_a_free_rollout_misses_does_not_explain_it():
    left = {"quadratic_drag": 0.6, "control_delay": 0.8}
    for missed_m, names in ((2 * FLOOR_M, ["quadratic_drag"]), (FLOOR_M, ["quadratic_drag", "control_delay"])):
        found = [judged(name, CLEAR, left_m=share * missed_m) for name, share in left.items()]
        assert [each.name for each in explaining(found, missed_m)] == names


def test_one_episode_names_nothing_and_says_what_to_record():
    verdict = decide([judged("quadratic_drag", CLEAR)], P, 0.0, 1)
    assert verdict.outcome == Outcome.AMBIGUOUS
    assert "second episode" in verdict.experiment


def test_one_episode_without_any_effect_says_what_to_record_too():
    verdict = decide([judged("quadratic_drag", 0.5 * LEAST_GAIN)], P, 0.0, 1)
    assert (verdict.outcome, verdict.judged) == (Outcome.NONE, ())
    assert "one motion" in verdict.reason
    assert "second motion" in verdict.experiment


def test_structure_that_nothing_fits_is_unexplained():
    verdict = decide([judged("quadratic_drag", 1.0)], P, 2 * STRUCTURE_GAIN, 2)
    assert (verdict.outcome, verdict.judged) == (Outcome.UNEXPLAINED, ())


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
    verdict = decide([relaxes], {"viscoelasticity": 0.01}, 0.0, 2, second=False)
    assert verdict.outcome == outcome
