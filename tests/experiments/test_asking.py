"""The loop: it asks while nothing is decided, keeps what was recorded, and ends for a reason that it says."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from egophys_core.diagnosis.diagnosis import DetectionLimit, Estimate, NamedEffect, Outcome
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.errors import PlanningError
from egophys_core.experiments import PERSON, asking, diagnose_and_ask
from tests.diagnosis.findings import make_diagnosis, make_nothing_found

DRAG = DetectionLimit(effect="quadratic_drag", parameter="coefficient", unit="1/m", null=0.0, size=4.0, alike=())


class MadeUpLab:
    """Diagnoses that end as they are told, and a world that counts."""

    def __init__(self, monkeypatch, *outcomes, score=1.0, refusal=None):
        self.outcomes, self.score, self.refusal = list(outcomes), score, refusal
        self.diagnosed, self.asked_about, self.told, self.done = [], [], [], []
        monkeypatch.setattr(asking, "diagnose", self.diagnose)
        monkeypatch.setattr(asking, "choose", self.choose)

    def diagnose(self, twin, episodes, options, **rest):
        self.diagnosed.append(list(episodes))
        self.told.append((rest["asked"], rest["loads"]))
        outcome = self.outcomes.pop(0)
        is_named = outcome is Outcome.NAMED
        found = make_diagnosis() if is_named else replace(make_nothing_found(), outcome=outcome, limits=(DRAG,))
        return SimpleNamespace(diagnosis=found, twin="improved")

    def choose(self, twin, effects, limits, **rest):
        if self.refusal:
            raise PlanningError(self.refusal)
        assert twin == "improved"
        self.asked_about.append((list(effects), list(rest["known"])))
        self.done.append(list(rest["done"]))
        return [SimpleNamespace(score=self.score, motion=SimpleNamespace(name=f"motion {len(self.done)}"))]

    def world(self, proposal, number):
        return f"asked {number}"

    def answer(self, most=2, **rest):
        return diagnose_and_ask(
            "twin", ["lift", "pull"], DiagnosisOptions(), self.world, most=most, limits=PERSON, **rest
        )


def measured(diagnosis):
    """The same, as if what it names had been measured directly."""
    return replace(diagnosis, candidates=(replace(diagnosis.candidates[0], is_measured=True),))


def test_what_was_measured_is_not_asked_about(monkeypatch):
    lab = MadeUpLab(monkeypatch, Outcome.NAMED)
    monkeypatch.setattr(
        asking, "diagnose", lambda *_, **__: SimpleNamespace(diagnosis=measured(make_diagnosis()), twin="improved")
    )
    answer = lab.answer()
    assert answer.asked == ()
    assert answer.ended == "it is decided"


def test_what_residuals_name_has_to_hold_in_one_motion(monkeypatch):
    answer = MadeUpLab(monkeypatch, Outcome.NAMED, Outcome.NAMED).answer()
    assert len(answer.asked) == 1
    assert answer.ended == "it is decided"


@pytest.mark.parametrize("most", [0, 2])
def test_what_residuals_name_is_decided_where_nobody_can_be_asked(monkeypatch, most):
    lab = MadeUpLab(monkeypatch, Outcome.NAMED)
    if most:
        lab.world = None
    answer = lab.answer(most=most)
    assert answer.asked == ()
    assert answer.ended == "it is decided"


def test_it_says_why_what_residuals_name_is_not_asked_about(monkeypatch):
    answer = MadeUpLab(monkeypatch, Outcome.NAMED, refusal="a rod is held in clamps").answer()
    assert answer.ended == "it is decided, and not asked about: a rod is held in clamps"


@pytest.mark.parametrize(("upward", "decided"), [(0.02, True), (2.5, False)])
def test_what_is_one_thing_in_every_motion_is_decided(upward, decided):
    tilt = named("gravity_tilt", about_x=0.1, about_y=0.13)
    force = named("constant_body_force", x=1.27, y=-0.98, z=upward)
    found = make_diagnosis(outcome=Outcome.AMBIGUOUS, effects=(tilt, force), ambiguous=(tilt.name, force.name))
    assert asking.is_decided(SimpleNamespace(diagnosis=found)) is decided


def test_what_another_motion_would_tell_apart_is_not_decided():
    drag, slip = named("quadratic_drag", coefficient=3.8), named("grasp_slip", x=0.0, y=0.0, z=0.01, onset=2.0)
    found = make_diagnosis(outcome=Outcome.AMBIGUOUS, effects=(drag, slip), ambiguous=(drag.name, slip.name))
    assert not asking.is_decided(SimpleNamespace(diagnosis=found))


def named(name, **values):
    """An effect as a diagnosis names it."""
    estimates = {each: Estimate(value=value, unit="1", ci95=(value, value)) for each, value in values.items()}
    return NamedEffect(name=name, parameters=estimates, episodes_agree=True)


def test_it_asks_until_it_is_decided_and_fits_what_it_asked_for_first(monkeypatch):
    lab = MadeUpLab(monkeypatch, Outcome.NONE, Outcome.NONE, Outcome.NAMED)
    answer = lab.answer(most=5)
    assert lab.diagnosed == [["lift", "pull"], ["asked 1", "lift", "pull"], ["asked 2", "asked 1", "lift", "pull"]]
    assert answer.finding.diagnosis.outcome is Outcome.NAMED
    assert [each.before.diagnosis.outcome for each in answer.asked] == [Outcome.NONE, Outcome.NONE]
    assert lab.asked_about[0][1] == [DRAG]
    assert lab.done == [[], ["motion 1"]]


def test_every_diagnosis_knows_the_loads_and_how_often_was_asked(monkeypatch):
    lab = MadeUpLab(monkeypatch, Outcome.NONE, Outcome.NAMED)
    lab.answer(loads={"lift": 0.5})
    assert lab.told == [(0, {"lift": 0.5}), (1, {"lift": 0.5})]


def test_it_says_which_names_what_was_asked_for_did_not_support(monkeypatch):
    lab = MadeUpLab(monkeypatch, Outcome.NAMED, Outcome.NONE)
    monkeypatch.setattr(asking, "is_decided", lambda finding: False)
    answer = lab.answer(most=1)
    assert answer.ended.endswith("; no longer named with what was asked for: quadratic_drag")


def test_it_asks_no_oftener_than_allowed_and_nobody_without_a_world(monkeypatch):
    answer = MadeUpLab(monkeypatch, Outcome.NONE, Outcome.NONE).answer(most=1)
    assert len(answer.asked) == 1
    assert "as many as allowed" in answer.ended
    lab = MadeUpLab(monkeypatch, Outcome.NONE)
    lab.world = None
    assert lab.answer().asked == ()


def test_a_motion_that_shows_little_more_is_not_asked_for(monkeypatch):
    answer = MadeUpLab(monkeypatch, Outcome.NONE, score=0.01).answer()
    assert answer.asked == ()
    assert "no motion" in answer.ended


def test_what_cannot_be_moved_by_hands_is_said(monkeypatch):
    answer = MadeUpLab(monkeypatch, Outcome.NONE, refusal="a rod is held in clamps").answer()
    assert answer.asked == ()
    assert answer.ended == "a rod is held in clamps"


def test_progress_never_goes_back(monkeypatch):
    lab = MadeUpLab(monkeypatch, Outcome.NONE, Outcome.NONE, Outcome.NONE)
    reported = []
    diagnose = lab.diagnose

    def with_progress(*args, progress, **rest):
        for share in (0.0, 0.5, 1.0):
            progress("fit", share)
        return diagnose(*args, **rest)

    monkeypatch.setattr(asking, "diagnose", with_progress)
    lab.answer(progress=lambda stage, share: reported.append(share))
    assert (np.diff(reported) >= 0.0).all()
    assert reported[-1] == pytest.approx(1.0)
