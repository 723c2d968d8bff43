"""The report of a diagnosis: plain words first, escaped, alone in its file, and there for whatever was found."""

import base64
import re
import warnings
from dataclasses import asdict, replace
from html.parser import HTMLParser

import numpy as np
import pytest

from egophys_core.diagnosis.diagnosis import Diagnosis, Estimate, Evidence, NamedEffect, Outcome
from egophys_core.reporting import EffectText, diagnosis_html, headline
from egophys_core.reporting.diagnosis_words import change, join
from tests.diagnosis.findings import (
    episode_error,
    make_decision,
    make_diagnosis,
    make_evidence,
    make_nothing_found,
)

TEXTS = {
    "quadratic_drag": EffectText(
        summary="air drag, as of the square of the speed: no lift",
        equation="a = -c |v| v",
        nulls={"coefficient": 0.0},
    )
}
VOID = {"meta", "img", "rect"}


class Reader(HTMLParser):
    """Checks that tags close in order; collects them, their attributes and the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.text.append(data)


def write(diagnosis: Diagnosis, evidence: Evidence | None = None) -> str:
    evidence = evidence or make_evidence(("swing",), points=5)
    # Whatever a drawing warns of (a mean of nothing, a division by zero) would be wrong in the picture too.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return diagnosis_html(diagnosis.as_dict(), **asdict(evidence), texts=TEXTS)


def read(diagnosis: Diagnosis, evidence: Evidence | None = None) -> str:
    """The text of the page."""
    return " ".join(" ".join(Reader(write(diagnosis, evidence)).text).split())


def test_the_plain_sentence_comes_first():
    text = read(make_diagnosis())
    sentence = (
        "The twin lacks one thing: air drag, as of the square of the speed. "
        "With it, the error on episodes it was not fitted to falls from 12.0 to 5.0 mm."
    )
    assert headline(make_diagnosis().as_dict(), TEXTS) == sentence
    before, _, _ = text.partition(sentence)
    assert before.split() == ["Diagnosis", "of", "twin", "93f0a1b2c3d4e5f6", "effect", "found"]


def test_all_that_was_asked_for_is_there():
    text = read(make_diagnosis())
    for part in (
        "quadratic_drag gains 406 on held-out data.",
        "a = -c |v| v",
        "3.8 1/m 2.75 to 4.6",
        "swing not fitted 12.0 5.0 -58 % 6.6 4.0 2.5 -38 %",
        "bending_damping -900 0.4",
        "near the hand 2.0",
        "on the table -",
        "swing at 3.12 s",
        "a = -3.5 |v| v (1/m)",
        "0123456789abcdef",
    ):
        assert part in text


def test_why_it_ended_so_is_there_with_the_criteria_of_every_effect():
    text = read(make_nothing_found())
    missed = "held-out gain by slopes: 4.1, needs at least 8.33 for a refit"
    for part in (
        f"Why this outcome No candidate passes all criteria. Decided by quadratic_drag: {missed}. (rule no_candidate",
        f"What came nearest, and what it failed: quadratic_drag: {missed} bending_damping: {missed}; {missed}",
        "quadratic_drag passes all 1 held_out_gain",
        "bending_damping fails 1 of 1 worth_a_refit",
        "quadratic_drag passed held_out_gain gain on left-out data 406, needs at least 50",
        "quadratic_drag not asked every_episode",
        f"bending_damping failed worth_a_refit {missed}",
    ):
        assert part in text


def test_a_second_search_says_beside_what_it_was_made():
    decisions = (make_decision(), make_decision(beside=("quadratic_drag",), candidate=None))
    text = read(make_diagnosis(decisions=decisions))
    assert "Beside quadratic_drag: One candidate passes all criteria. Decided by gain on left-out data 406" in text
    assert "What came nearest" not in text


def test_pictures_are_inside_one_for_each_episode_and_one_of_the_object():
    page = Reader(write(make_diagnosis(), make_evidence(("lift", "pull", "swing"))))
    sources = [value for name, value in page.attributes if name == "src"]
    assert len(sources) == 4
    for source in sources:
        kind, _, content = source.partition(",")
        assert kind == "data:image/png;base64"
        assert base64.b64decode(content, validate=True).startswith(b"\x89PNG")


def test_works_without_a_network_and_without_scripts():
    text = write(make_diagnosis())
    assert not {"script", "link", "iframe", "object"} & set(Reader(text).tags)
    assert "url(" not in text
    assert not re.findall(r"(?:https?:)?//\w", re.sub(r"base64,[^\"]*", "", text))


def test_a_page_of_six_episodes_and_many_points_is_small():
    names = tuple(f"episode_{index}" for index in range(6))
    errors = tuple(episode_error(name, fitted=name < "episode_2") for name in names)
    text = write(make_diagnosis(error=errors), make_evidence(names, points=2000))
    assert len(text.encode()) < 1_000_000


def test_every_text_is_escaped():
    bad = '<script>alert("$x_1$ & more")</script>'
    diagnosis = make_diagnosis(
        outcome=Outcome.AMBIGUOUS,
        effects=(
            NamedEffect(name=bad, parameters={bad: Estimate(value=1, unit=bad, ci95=(0, 2))}, episodes_agree=False),
        ),
        experiment=bad,
        reason=bad,
        twin_id=bad,
        improved_twin_id=bad,
        error=(episode_error(bad),),
        where=replace(make_diagnosis().where, law=bad, by_region={bad: 0.1}, worst_time_s={bad: 1.0}),
        candidates=(replace(make_diagnosis().candidates[0], name=bad, values={bad: 1.0}),),
    )
    text = write(diagnosis, make_evidence((bad,)))
    assert "<script" not in text
    read_back = Reader(text)
    assert "script" not in read_back.tags
    assert sum(bad in each for each in read_back.text) > 10


@pytest.mark.parametrize(
    ("outcome", "names", "part"),
    [
        (Outcome.NONE, (), "noise and a coarse model. It is off by 12.0 mm on episodes it was not fitted to."),
        (
            Outcome.AMBIGUOUS,
            ("quadratic_drag", "anisotropy"),
            "cannot tell what: air drag, as of the square of the speed; or anisotropy.",
        ),
        (Outcome.AMBIGUOUS, ("anisotropy",), "perhaps this: anisotropy. These recordings are too few"),
        (Outcome.NAMED, ("a", "quadratic_drag"), "2 things: a; and air drag, as of the square of the speed. With"),
        (Outcome.NAMED_AND_UNEXPLAINED, ("a",), "lacks one thing: a. With it, the error"),
        (
            Outcome.NAMED_AND_AMBIGUOUS,
            ("known", "b", "c"),
            "lacks one thing: known. It lacks one more, and these recordings cannot tell which: b or c. With it, the",
        ),
        (Outcome.UNEXPLAINED, (), "in a way that no known effect explains. It is off by 12.0 mm"),
    ],
)
def test_each_outcome_has_its_words(outcome, names, part):
    named = make_diagnosis().effects[0]
    is_open = outcome in (Outcome.AMBIGUOUS, Outcome.NAMED_AND_AMBIGUOUS)
    diagnosis = make_diagnosis(
        outcome=outcome,
        effects=tuple(replace(named, name=name) for name in names),
        ambiguous=tuple(name for name in names if is_open and name != "known"),
    )
    assert part in headline(diagnosis.as_dict(), TEXTS)
    assert part in read(diagnosis)


def test_the_experiment_stands_out():
    diagnosis = make_diagnosis(outcome=Outcome.AMBIGUOUS, experiment="swing it by one corner at two speeds")
    assert "What to do next: swing it by one corner at two speeds" in read(diagnosis)
    assert "What to do next" not in read(make_diagnosis())


def test_with_fitted_episodes_only_the_sentence_says_so():
    content = make_diagnosis(error=(episode_error("lift", fitted=True),)).as_dict()
    assert headline(content, TEXTS).endswith("the error on the episodes it was fitted to falls from 11.0 to 4.0 mm.")


def test_an_error_that_grows_is_not_said_to_fall():
    content = make_diagnosis(error=(episode_error("swing", before=0.005, after=0.006),)).as_dict()
    assert "goes from 5.0 to 6.0 mm" in headline(content, TEXTS)


@pytest.mark.parametrize(
    ("before", "after", "shown"),
    [(10.0, 4.0, "-60 %"), (4.0, 5.0, "+25 %"), (10.0, 9.97, "0 %"), (0.0, 1.0, "-"), (1.0, None, "-")],
)
def test_change_in_per_cent(before, after, shown):
    assert change(before, after) == shown


@pytest.mark.parametrize(
    ("words", "joined"),
    [([], ""), (["a"], "a"), (["a", "b"], "a or b"), (["a", "b", "c"], "a, b or c"), (["a, b", "c"], "a, b; or c")],
)
def test_words_are_joined(words, joined):
    assert join(words, "or") == joined


@pytest.mark.parametrize("number", [float("nan"), float("inf"), None])
def test_numbers_that_are_not_there(number):
    named = make_diagnosis().effects[0]
    unknown = Estimate(value=3.8, unit="1/m", ci95=(number, 4.6))
    diagnosis = make_diagnosis(
        effects=(replace(named, parameters={"coefficient": unknown}),),
        error=(episode_error("swing", after=number) if number is not None else _without_numbers("swing"),),
        candidates=(replace(make_diagnosis().candidates[0], held_out_gain=number, p_null=number),),
    )
    nothing = np.full(60, np.nan)
    evidence = replace(make_evidence(("swing",)), before={"swing": nothing}, after={"swing": np.full(60, np.inf)})
    text = read(diagnosis, evidence)
    assert "does not stay stable" in text
    assert " nan " not in text
    assert " inf " not in text
    assert "None" not in text


def _without_numbers(name):
    return replace(episode_error(name), track_before_m=None, track_after_m=None)


@pytest.mark.parametrize("points", [1, 3])
@pytest.mark.parametrize("size", [0.0, float("nan"), 0.5])
def test_few_points_and_odd_residuals_are_drawn(points, size):
    evidence = make_evidence(("swing",), points=points)
    text = write(make_diagnosis(), replace(evidence, field=np.full((points, 3), size)))
    assert text.count("<img") == 2


def test_a_line_of_markers_is_drawn():
    evidence = make_evidence(("swing",), points=5)
    rest = np.linspace([0.0, 0.0, 0.1], [0.1, 0.0, 0.1], 5)
    assert write(make_diagnosis(), replace(evidence, rest=rest)).count("<img") == 2
