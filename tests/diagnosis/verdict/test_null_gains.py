"""The null of gains: what it was learned from is spread evenly by it, and it knows no gain that is certain."""

import json
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from egophys_core.diagnosis.verdict.null_gains import p_null

RECORDED = Path(__file__).resolve().parents[3] / "benchmarks/results/injected.json"


def test_sets_without_an_effect_have_any_p_alike():
    rows = [each for each in json.loads(RECORDED.read_text())["rows"] if each["effect"] == "none"]
    shares = [p_null(max(each["held_out_gain"] for each in row["candidates"])) for row in rows]
    assert len(shares) >= 20
    assert kstest(shares, "uniform").pvalue > 0.2


@given(st.floats(-1e6, 1e6), st.floats(0.0, 1e6))
def test_more_gain_is_no_likelier(gain, more):
    assert 0.0 <= p_null(gain + more) <= p_null(gain) <= 1.0


def test_nothing_gained_is_what_chance_gains():
    assert np.all([p_null(gain) == 1.0 for gain in (-5.0, 0.0)])
