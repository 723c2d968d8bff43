"""The nulls of gains: what each was learned from is spread evenly by it, and no gain is certain."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from egophys_core.diagnosis.null_gains import ASKED, RECORDED, NullGains, null_gains
from egophys_core.diagnosis.thresholds import thresholds_for

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks/results"


def test_recorded_sets_without_an_effect_have_any_p_alike():
    rows = [each for each in json.loads((RESULTS / "injected.json").read_text())["rows"] if each["effect"] == "none"]
    shares = [RECORDED.p(max(each["held_out_gain"] for each in row["candidates"])) for row in rows]
    assert len(shares) >= 20
    assert kstest(shares, "uniform").pvalue > 0.2


def test_sets_that_asked_have_any_p_alike():
    rows = json.loads((RESULTS / "asked.json").read_text())["calibrated_on"]
    assert len(rows) >= 15
    assert kstest([ASKED.p(row["gain"]) for row in rows], "uniform").pvalue > 0.2


def test_sets_on_which_nothing_was_calibrated_have_any_p_alike():
    shares = json.loads((RESULTS / "asked.json").read_text())["p_null"]
    assert len(shares) >= 25
    assert kstest(shares, "uniform").pvalue > 0.2


def test_more_is_asked_of_effects_after_motions_that_show_them():
    assert null_gains(0) is RECORDED
    assert null_gains(1).p(100.0) > 2.0 * null_gains(0).p(100.0)


@pytest.mark.parametrize("asked", [0, 2])
def test_few_sets_that_lack_nothing_are_said_to_have_structure(asked):
    null = null_gains(asked)
    assert 0.05 < null.p(thresholds_for(0.0, 0.0, null).structure_gain) < 0.2


@pytest.mark.parametrize("share", [0.5, 0.05, 1.0 / 40.0])
def test_a_gain_is_reached_by_the_share_it_was_asked_for(share):
    null = NullGains(mean=20.0)
    assert null.p(null.gain_of(share)) == pytest.approx(share)


@given(st.floats(-1e6, 1e6), st.floats(0.0, 1e6))
def test_more_gain_is_no_likelier(gain, more):
    assert 0.0 <= RECORDED.p(gain + more) <= RECORDED.p(gain) <= 1.0


def test_nothing_gained_is_what_chance_gains():
    assert np.all([RECORDED.p(gain) == 1.0 for gain in (-5.0, 0.0)])
