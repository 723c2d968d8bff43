"""The section of the report that says why a diagnosis ended as it did: which rule and criterion decided, and how every
candidate fared."""

from collections.abc import Mapping, Sequence
from typing import Any

from egophys_core.reporting.diagnosis_words import join
from egophys_core.reporting.html_page import Table

PASSED, FAILED, NOT_ASKED = "passed", "failed", "not asked"


def why_this_outcome(content: Mapping[str, Any]) -> dict[str, Any]:
    """The deciding criterion of each search, the nearest misses, and all criteria of all candidates.

    Args:
        content: of `diagnosis.json`.

    Returns:
        What the template asks for: decisions, and the tables standing and criteria.
    """
    candidates = content["candidates"]
    return {
        "decisions": [
            {
                "words": decision_in_words(each),
                "rule": each["rule"],
                "misses": [miss_in_words(miss) for miss in each["nearest_misses"]],
            }
            for each in content["decisions"]
        ],
        "standing": Table(
            header=("effect", "", "failed", "passed"),
            rows=[[each["name"], _standing(each["criteria"]), *_lists(each["criteria"])] for each in candidates],
            kinds=("", "text", "text", "text"),
        ),
        "criteria": Table(
            header=("effect", "", "criterion", "found and asked"),
            rows=[
                [each["name"], _label(result), result["name"], result["sentence"]]
                for each in candidates
                for result in each["criteria"]
            ],
            kinds=("", "text", "text", "text"),
        ),
    }


def decision_in_words(decision: Mapping[str, Any]) -> str:
    """The rule that made an outcome and the criterion that decided, with its numbers."""
    beside = f"Beside {join(decision['beside'], 'and')}: " if decision["beside"] else ""
    whose = f"{decision['candidate']}: " if decision["candidate"] else ""
    return f"{beside}{decision['sentence']} Decided by {whose}{decision['criterion']['sentence']}."


def miss_in_words(miss: Mapping[str, Any]) -> str:
    """A candidate and the criteria that it failed, with their numbers."""
    return f"{miss['candidate']}: {'; '.join(each['sentence'] for each in miss['failed'])}"


def _standing(criteria: Sequence[Mapping[str, Any]]) -> str:
    failed = sum(not each["passed"] for each in criteria)
    asked = sum(bool(each["applied"]) for each in criteria)
    return f"fails {failed} of {asked}" if failed else f"passes all {asked}"


def _lists(criteria: Sequence[Mapping[str, Any]]) -> list[str]:
    """The names of the criteria that failed, and of those that passed."""
    return [", ".join(each["name"] for each in criteria if _label(each) == label) for label in (FAILED, PASSED)]


def _label(result: Mapping[str, Any]) -> str:
    if not result["passed"]:
        return FAILED
    return PASSED if result["applied"] else NOT_ASKED
