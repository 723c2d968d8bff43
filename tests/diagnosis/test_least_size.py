"""The least size that gains enough, corrected by refits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from egophys_core.diagnosis.least_size import corrected_share


@given(st.floats(0.05, 0.9), st.floats(1.5, 3.0), st.floats(0.03, 1.0))
def test_ends_near_where_the_gain_is_what_is_needed(there, power, first):
    found = corrected_share(lambda share: 100.0 * (share / there) ** power, 100.0, first=first)
    assert found is not None
    assert found == pytest.approx(there, rel=0.35)


@given(st.floats(0.02, 1.0), st.floats(-50.0, 50.0))
def test_what_never_gains_enough_is_none(first, most):
    assert corrected_share(lambda share: most * share, 100.0, first=first) is None


def test_what_cannot_be_told_stays():
    assert corrected_share(lambda share: None, 100.0, first=0.4) == 0.4
