"""The choice of a motion: limits of recordings together, what counts, and what a sheet's own twin would choose."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.errors import PlanningError
from egophys_core.experiments import PERSON, arm_hands, choice, choose, motions_for, sensitivity
from egophys_core.experiments.choice import together
from egophys_core.experiments.prediction import predicted_episode
from egophys_core.experiments.sensitivity import limits_in
from egophys_core.robot import MotionLimits
from egophys_core.simulation import ContactKind
from tests.effects.situations import sheet
from tests.experiments.twins import twin_of

DRAG = DetectionLimit(effect="quadratic_drag", parameter="coefficient", unit="1/m", null=0.0, size=4.0, alike=())
GRAVITY = DetectionLimit(effect="gravity_scale", parameter="scale", unit="1", null=1.0, size=0.2, alike=())


def chosen(monkeypatch, shown, **options):
    """What is chosen where motions show what `shown` says, by name, and the others nothing."""
    monkeypatch.setattr(choice, "predicted_episode", lambda model, motion, **rest: motion)
    monkeypatch.setattr(choice, "limits_in", lambda model, motion, effects, **rest: shown.get(motion.name, ()))
    found = choose(
        twin_of(sheet()), ["quadratic_drag", "gravity_scale"], PERSON, needed_gain=50.0, least_scale=1e-3, **options
    )
    return [each.motion.name for each in found]


def test_two_recordings_that_show_alike_show_two_thirds_of_the_size_together():
    assert together(DRAG, DRAG).size == pytest.approx(4.0 / np.sqrt(2.0))
    assert together(None, DRAG) == together(replace(DRAG, size=None), DRAG) == DRAG
    assert together(DRAG, replace(DRAG, size=None)).size == 4.0


def test_what_one_of_two_recordings_tells_apart_is_told():
    hidden = replace(DRAG, alike=("gravity_scale", "uneven_mass"))
    assert together(hidden, replace(DRAG, alike=("uneven_mass",))).alike == ("uneven_mass",)


def test_the_motion_that_shows_the_smallest_size_is_done_first(monkeypatch):
    shown = {"hang still, one hand": (DRAG,), "drag fast, one hand": (replace(DRAG, size=1.0),)}
    assert chosen(monkeypatch, shown)[0] == "drag fast, one hand"


def test_what_is_expected_of_the_chosen_motion_is_what_refitted_twins_would_show(monkeypatch):
    monkeypatch.setattr(choice, "predicted_episode", lambda model, motion, **rest: motion)
    monkeypatch.setattr(
        choice,
        "limits_in",
        lambda model, motion, effects, refitted, **rest: (replace(DRAG, size=1.0 if refitted else 3.0),),
    )
    best, *_ = choose(twin_of(sheet()), ["quadratic_drag"], PERSON, needed_gain=50.0, least_scale=1e-3)
    assert best.after[0].size == 1.0


def test_a_second_motion_is_proposed_only_if_it_shows_more(monkeypatch):
    best = {"drag fast, one hand": (replace(DRAG, size=1.0), GRAVITY)}
    little = {"hang still, one hand": (replace(DRAG, size=5.0), replace(GRAVITY, size=2.0))}
    much = {"hang still, one hand": (replace(DRAG, size=5.0), replace(GRAVITY, size=0.02))}
    assert chosen(monkeypatch, best | little) == ["drag fast, one hand"]
    assert chosen(monkeypatch, best | much) == ["hang still, one hand", "drag fast, one hand"]


def test_what_looks_alike_in_a_motion_is_not_learned_from_it(monkeypatch):
    alike = (replace(DRAG, size=1.0, alike=("gravity_scale",)), replace(GRAVITY, alike=("quadratic_drag",)))
    shown = {"hang still, one hand": alike, "drag fast, one hand": (DRAG, GRAVITY)}
    assert chosen(monkeypatch, shown)[0] == "hang still, one hand"
    assert chosen(monkeypatch, shown, rivals=["quadratic_drag", "gravity_scale"])[0] == "drag fast, one hand"


def test_what_recordings_show_already_counts_for_little(monkeypatch):
    shown = {"hang still, one hand": (replace(DRAG, size=1.0),), "drag fast, one hand": (GRAVITY,)}
    assert chosen(monkeypatch, shown, known=[replace(DRAG, size=0.5)])[0] == "drag fast, one hand"


def test_a_motion_that_was_done_is_not_proposed_again(monkeypatch):
    shown = {
        "hang still, one hand": (replace(DRAG, size=1.0),),
        "drag fast, one hand": (replace(DRAG, size=2.0),),
    }
    assert chosen(monkeypatch, shown)[0] == "hang still, one hand"
    assert chosen(monkeypatch, shown, done=["hang still, one hand"]) == ["drag fast, one hand"]
    every = [each.name for each in motions_for(twin_of(sheet()), PERSON)]
    with pytest.raises(PlanningError, match=r"no motion .* but those that were asked for: "):
        chosen(monkeypatch, shown, done=every)


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        (
            {"max_acceleration_m_s2": 0.05},
            r"allow no motion .*not 'hang still, one hand'.* \(waypoint 0 .*acceleration",
        ),
        ({"max_step_m": 0.01}, r"not 'hang and swing.*, 'hang still, one hand', .* \(waypoint 1 .* \(max_step_m\)"),
        ({"min_interval_s": 10.0}, "must be at least 10.0 s later"),
        ({"workspace_min_m": (0.2, -0.4, 0.1)}, r"z = 0\.0\d+ m is outside the workspace 0.100 \.\. 0.500"),
        ({"max_speed_m_s": 0.005}, "at most 0.005 m/s is too slow for any motion of at most 12 s .* a higher speed"),
    ],
)
def test_an_arm_is_told_which_of_its_limits_allow_nothing(limits, reason):
    hands = arm_hands(MotionLimits(**limits))
    with pytest.raises(PlanningError, match=reason):
        choose(twin_of(sheet()), ["quadratic_drag"], hands, needed_gain=50.0, least_scale=1e-3)


def test_an_arm_does_what_its_limits_allow(monkeypatch):
    monkeypatch.setattr(choice, "predicted_episode", lambda model, motion, **rest: motion)
    tried = set()
    monkeypatch.setattr(choice, "limits_in", lambda model, motion, effects, **rest: tried.add(motion.name) or (DRAG,))
    # Too narrow for all but what goes straight up.
    for low, high in (((0.2, -0.4, 0.0), (0.65, 0.4, 0.5)), ((0.2, -0.4, 0.0), (0.201, -0.399, 0.5))):
        hands = arm_hands(MotionLimits(workspace_min_m=low, workspace_max_m=high))
        tried.clear()
        choose(twin_of(sheet()), ["quadratic_drag"], hands, needed_gain=50.0, least_scale=1e-3)
        assert ("drag fast, one hand" in tried) == (high[0] > 0.3)
        assert {"hang still, one hand", "turn the wrist, one hand"} <= tried


def test_a_twin_that_can_be_simulated_in_no_motion_is_refused(monkeypatch):
    def fail(*_, **__):
        raise PlanningError("it diverges")

    monkeypatch.setattr(choice, "predicted_episode", fail)
    with pytest.raises(PlanningError, match="none of the motions"):
        choose(twin_of(sheet()), ["quadratic_drag"], PERSON, needed_gain=50.0, least_scale=1e-3)


def test_a_motion_is_predicted_as_it_would_be_recorded():
    motion = next(each for each in motions_for(twin_of(sheet()), PERSON) if "drop, two" in each.name)
    episode = predicted_episode(sheet(), motion, ground_height=0.0)
    assert episode.contact is not None
    held = np.flatnonzero(episode.contact.all(axis=1))
    heights = np.nanmean(episode.points[..., 2], axis=1)
    assert ContactKind.HOLD == 1
    assert heights[held[0]] == pytest.approx(heights[0], abs=2e-3)
    assert heights[held[-1]] > heights[0] + 0.03
    assert heights[-1] < heights[held[-1]] - 0.03


def test_what_hangs_in_a_hand_is_swung_by_it_and_never_near_a_table():
    flat = sheet()
    nodes = flat.graph.positions
    hanging = np.column_stack([nodes[:, 0], np.zeros(len(nodes)), nodes[:, 1]]).astype(np.float32)
    model = replace(flat, graph=replace(flat.graph, positions=hanging))
    top = hanging[hanging[:, 2] > hanging[:, 2].max() - 1e-3]
    twin = twin_of(model, grasp=top[[0, -1]], ground_height=-10.0)
    motions = motions_for(twin, PERSON)
    assert {len(each.paths) for each in motions} == {1}
    assert not any("lift" in each.sentence or "drag" in each.name for each in motions)
    swing = next(each for each in motions if each.name.startswith("hang and swing"))
    episode = predicted_episode(model, swing, ground_height=-10.0)
    assert episode.contact is not None
    assert episode.contact.all()
    aside = np.ptp(episode.controllers, axis=0)
    assert aside[:, 1].min() > 0.05
    assert aside[:, [0, 2]].max() < 1e-3


def test_a_swing_shows_drag_at_a_smaller_size_than_a_slow_drag_over_the_table():
    model, found = sheet(), {}
    for motion in motions_for(twin_of(model), PERSON):
        if motion.name in ("hang and swing at 1.5 Hz and drop, two hands", "drag slowly, two hands"):
            episode = predicted_episode(model, motion, ground_height=0.0)
            limit, *_ = limits_in(model, episode, ["quadratic_drag"], needed_gain=50.0, least_scale=1e-3)
            found[motion.name] = limit.size or np.inf
    swing, drag = found["hang and swing at 1.5 Hz and drop, two hands"], found["drag slowly, two hands"]
    assert 0.1 < swing < 20.0
    assert drag > 3.0 * swing


def test_of_an_object_with_one_graph_alone_the_least_residuals_set_the_limits(monkeypatch):
    # A cable has no variants.
    monkeypatch.setattr(
        sensitivity, "kind_of", lambda model: SimpleNamespace(variants=lambda model: [], lies_flat=True)
    )
    model = sheet()
    motion = next(each for each in motions_for(twin_of(model), PERSON) if each.name == "hang still and drop, two hands")
    episode = predicted_episode(model, motion, ground_height=0.0)
    fine, coarse = (
        limits_in(model, episode, ["gravity_scale"], needed_gain=50.0, least_scale=scale)[0].size or np.inf
        for scale in (1e-4, 1e-3)
    )
    assert fine < 0.5 * coarse
