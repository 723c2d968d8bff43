"""How what was measured and what searches find make one outcome; the searches here are of hand-made verdicts."""

from types import SimpleNamespace
from typing import Any

import pytest

from egophys_core.diagnosis.diagnosis import Outcome
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.problem import DiagnosisProblem
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.verdict import explain
from tests.diagnosis.findings import make_decision

DELAY = SimpleNamespace(name="control_delay", shows=True, reason="control_delay is measured", alike=())
ABSENT = SimpleNamespace(name="tracking_scale", shows=False, reason="tracking_scale is measured", alike=())
FORCE = SimpleNamespace(name="force")
ASIDE = SimpleNamespace(name="tilt", shows=True, reason="tilt is measured", alike=(FORCE,))
PUSHED = SimpleNamespace(name="gust", shows=True, reason="gust is measured", alike=(FORCE,))


def judged(name: str) -> SimpleNamespace:
    return SimpleNamespace(name=name, fitted=f"with {name}", gain=1000.0)


def verdict(outcome: Outcome, *names: str) -> SimpleNamespace:
    return SimpleNamespace(
        outcome=outcome,
        named=tuple(map(judged, names)),
        reason=f"{outcome} {' '.join(names)}",
        experiment="a motion" if outcome == Outcome.AMBIGUOUS else None,
        decision=make_decision(rule=str(outcome)),
    )


NONE, UNEXPLAINED = verdict(Outcome.NONE), verdict(Outcome.UNEXPLAINED)
DRAG, TETHER = verdict(Outcome.NAMED, "drag"), verdict(Outcome.NAMED, "tether")
EITHER = verdict(Outcome.AMBIGUOUS, "tilt", "force")


@pytest.mark.parametrize(
    ("measured", "verdicts", "outcome", "certain", "ambiguous", "fitted"),
    [
        ([], [NONE], Outcome.NONE, [], [], "relieved"),
        ([], [UNEXPLAINED], Outcome.UNEXPLAINED, [], [], "relieved"),
        ([], [EITHER], Outcome.AMBIGUOUS, [], ["tilt", "force"], "with tilt"),
        ([], [DRAG, NONE], Outcome.NAMED, ["drag"], [], "with drag"),
        ([], [DRAG, TETHER], Outcome.NAMED, ["drag", "tether"], [], "with tether"),
        ([], [DRAG, EITHER], Outcome.NAMED_AND_AMBIGUOUS, ["drag"], ["tilt", "force"], "with tilt"),
        ([DELAY], [EITHER], Outcome.NAMED_AND_AMBIGUOUS, ["control_delay"], ["tilt", "force"], "with tilt"),
        ([DELAY], [NONE], Outcome.NAMED, ["control_delay"], [], "baseline"),
        ([DELAY], [DRAG], Outcome.NAMED, ["control_delay", "drag"], [], "with drag"),
        ([ABSENT], [DRAG, NONE], Outcome.NAMED, ["drag"], [], "with drag"),
        ([DELAY, ABSENT], [NONE], Outcome.NAMED, ["control_delay"], [], "baseline"),
        ([ASIDE], [NONE], Outcome.AMBIGUOUS, [], ["tilt", "force"], "baseline"),
        ([ASIDE], [DRAG], Outcome.NAMED_AND_AMBIGUOUS, ["drag"], ["tilt", "force"], "with drag"),
        ([DELAY, ASIDE], [NONE], Outcome.NAMED_AND_AMBIGUOUS, ["control_delay"], ["tilt", "force"], "baseline"),
        ([ASIDE, PUSHED], [NONE], Outcome.AMBIGUOUS, [], ["tilt", "force", "gust"], "baseline"),
        ([DELAY], [UNEXPLAINED], Outcome.NAMED_AND_UNEXPLAINED, ["control_delay"], [], "baseline"),
    ],
)
def test_the_outcome_is_of_all_that_was_found(
    monkeypatch: pytest.MonkeyPatch,
    measured: list[Any],
    verdicts: list[SimpleNamespace],
    outcome: Outcome,
    certain: list[str],
    ambiguous: list[str],
    fitted: str,
):
    asked, needed = [], []

    def search(
        problem: Any, before: Any, without: set[str], progress: Any, *, tried: list[Any], others: list[Any]
    ) -> SimpleNamespace:
        assert tried == ["made otherwise"]
        asked.append(without)
        needed.append(problem.thresholds.second_gain)
        progress("search", 1.0)
        return SimpleNamespace(verdict=verdicts[len(asked) - 1], before="relieved")

    monkeypatch.setattr(explain, "search", search)
    monkeypatch.setattr(explain, "experiment_for", lambda name, one_motion: f"a motion for {name}")
    shares: list[float] = []
    baseline: Any = SimpleNamespace(fitted="baseline", tried=["made otherwise"], others=["another"])
    thresholds = Thresholds(second_gain=80.0, second_share=0.25)
    problem = DiagnosisProblem(
        observations=[], validation=[], options=DiagnosisOptions(), seed=0, thresholds=thresholds
    )
    found = explain.explain(
        problem,
        baseline,
        measured,
        {"grasp_slip"},
        lambda stage, share: shares.append(share),
    )
    assert found.outcome == outcome
    assert [each.name for each in found.named] == [*certain, *ambiguous]
    assert list(found.ambiguous) == ambiguous
    assert bool(found.experiment) == bool(ambiguous)
    assert found.fitted == fitted
    assert len(asked) == len(verdicts)
    assert needed == [80.0, 250.0][: len(verdicts)]
    assert shares == sorted(shares)
    assert asked[0] == {"grasp_slip", *(each.name for each in measured)}
    for each in (*(one for one in measured if one.shows), *(one for one in verdicts if one.outcome == Outcome.NAMED)):
        assert each.reason in found.reason
    assert ABSENT.reason not in found.reason
    assert [each.rule for each in found.decisions] == [str(each.outcome) for each in verdicts]
    shown = tuple(each.name for each in measured if each.shows)
    assert found.decisions[0].beside == shown
    assert found.decisions[-1].beside == (*shown, *(each.named[0].name for each in verdicts[:-1]))
