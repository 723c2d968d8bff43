"""The least size that gains enough, corrected by refits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from egophys_core.diagnosis.least_size import Look, corrected_shares

NEEDED = 100.0


def corrected(gain, first):
    """The share of one effect that gains `gain` at a share, or what is known of several, by index."""
    (found,) = corrected_shares(
        lambda looks: {index: gain(look.share) for index, look in looks.items()}, [Look(share=first, needed=NEEDED)]
    )
    return found


@given(st.floats(0.05, 0.9), st.floats(1.5, 3.0), st.floats(0.03, 1.0))
def test_ends_near_where_the_gain_is_what_is_needed(there, power, first):
    found = corrected(lambda share: NEEDED * (share / there) ** power, first)
    assert found is not None
    assert found == pytest.approx(there, rel=0.35)


@given(st.floats(0.02, 1.0), st.floats(-50.0, 50.0))
def test_what_never_gains_enough_is_none(first, most):
    assert corrected(lambda share: most * share, first) is None


def test_what_cannot_be_told_stays():
    assert corrected(lambda share: None, 0.4) == 0.4


def test_each_is_looked_at_until_it_is_found():
    asked = []

    def gains(looks):
        asked.append(sorted(looks))
        return {index: 20.0 * look.needed * look.share ** (2.0 if index else 1.0) for index, look in looks.items()}

    first = [Look(share=share, needed=needed) for share, needed in ((1.0, 30.0), (0.25, 60.0), (0.2, NEEDED))]
    found = corrected_shares(gains, first)
    assert asked[:2] == [[0, 1, 2], [0]]
    assert found == pytest.approx([0.05, 20.0**-0.5, 20.0**-0.5], rel=0.3)
