"""The prior's set: what is in it, that it can be made in parts, and that it is what was recorded."""

import json
import warnings
from collections import Counter

import numpy as np
import pytest

from benchmarks.prior import dataset
from benchmarks.prior.dataset import ChecksumWarning, checksum, make_set, place, read_set, warn_of_others
from benchmarks.prior.sequences import SEQUENCES, Split
from egophys_core.rehearsal import RehearsalOptions

TRAINING = [each for each in SEQUENCES if each.split is Split.TRAINING]
HELD_OUT = [each for each in SEQUENCES if each.split is Split.HELD_OUT]


@pytest.fixture
def short(monkeypatch):
    """Episodes of a moment, made one after the other in this process."""
    monkeypatch.setattr(dataset, "OPTIONS", RehearsalOptions(duration_s=0.1, points=10))
    monkeypatch.setattr(
        dataset, "side_by_side", lambda measure, items, workers: ((each, measure(each)) for each in items)
    )
    two = tuple(each for each in TRAINING if each.shape == "toy")[:2]
    monkeypatch.setattr(dataset, "SEQUENCES", two)
    return two


def test_the_parts_have_their_sizes():
    assert (len(TRAINING), len(HELD_OUT)) == (64, 34)
    assert [sum(each.paper for each in part) for part in (TRAINING, HELD_OUT)] == [8, 11]
    assert len({each.name for each in SEQUENCES}) == len({each.seed for each in SEQUENCES}) == len(SEQUENCES)


def test_what_is_held_out_was_never_seen():
    seen, unseen = ({each.object_seed for each in part} for part in (TRAINING, HELD_OUT))
    assert not seen & unseen
    assert {each.shape for each in HELD_OUT} - {each.shape for each in TRAINING} == {"round_cloth", "two_lobed_toy"}
    assert {each.motion for each in HELD_OUT} - {each.motion for each in TRAINING} == {"fold", "double_pull", "shake"}
    assert {each.shape for each in TRAINING} < {each.shape for each in HELD_OUT}


def test_every_object_is_one_object_handled_twice():
    which = {each.object_seed: (each.shape, each.variation) for each in SEQUENCES}
    assert {(each.object_seed, each.shape, each.variation) for each in SEQUENCES} == {
        (seed, *rest) for seed, rest in which.items()
    }
    assert set(Counter(each.object_seed for each in SEQUENCES).values()) == {2}


def test_the_papers_sequences_are_those_of_its_table():
    """Plush toys but for a mitt, a bag and three towels; motions as in their names."""
    training, held_out = (
        Counter((each.shape, each.motion) for each in part if each.paper) for part in (TRAINING, HELD_OUT)
    )
    assert training == {
        ("toy", "double_lift"): 2,
        ("toy", "lift"): 2,
        ("toy", "pull"): 2,
        ("mitt", "lift"): 1,
        ("bag", "push"): 1,
    }
    assert held_out == {
        ("toy", "double_lift"): 1,
        ("toy", "lift"): 2,
        ("toy", "pull"): 2,
        ("toy", "push"): 3,
        ("towel", "fold"): 1,
        ("towel", "double_pull"): 1,
        ("towel", "lift"): 1,
    }


def test_only_what_is_missing_or_damaged_is_made_again(tmp_path, short):
    first, second = short
    told: list[tuple[str, int, int]] = []

    def tell(*what):
        told.append(what)

    made = make_set(tmp_path, short, report=tell)
    assert told == [(first.name, 1, 2), (second.name, 2, 2)]
    assert make_set(tmp_path, short, report=tell) == made
    assert len(told) == 2
    next(place(second, tmp_path).glob("*.mcap")).write_bytes(b"half")
    assert make_set(tmp_path, short, report=tell) == made
    assert told[2:] == [(second.name, 2, 2)]
    episodes = read_set(tmp_path, Split.TRAINING)
    assert [each.name for each in episodes] == [first.name, second.name]
    assert [checksum(each) for each in episodes] == [made[each.name] for each in episodes]
    assert all(np.isfinite(each.points).any() for each in episodes)


def test_an_episode_that_is_another_is_worth_a_warning(tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "CHECKSUMS", tmp_path / "checksums.json")
    dataset.CHECKSUMS.write_text(json.dumps({"a": "1", "b": "2"}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_others({"a": "1", "b": "2"})
    with pytest.warns(ChecksumWarning, match=r"1 of 2 episodes are not those of checksums.json, as b: made on another"):
        warn_of_others({"a": "1", "b": "3"})


def test_the_repository_knows_every_episode():
    assert json.loads(dataset.CHECKSUMS.read_text()).keys() == {each.name for each in SEQUENCES}
