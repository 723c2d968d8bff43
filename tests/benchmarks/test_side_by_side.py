"""Measurements side by side lose none, and begin none too late."""

import math
import os

import pytest

from benchmarks.side_by_side import side_by_side


def test_every_item_is_measured_once_in_another_process():
    assert dict(side_by_side(math.sqrt, [4.0, 9.0, 16.0, 25.0])) == {4.0: 2.0, 9.0: 3.0, 16.0: 4.0, 25.0: 5.0}
    assert os.getpid() not in dict(side_by_side(_process, range(3))).values()


def test_one_worker_does_one_after_the_other():
    assert list(side_by_side(math.sqrt, [9.0, 4.0, 1.0], workers=1)) == [(9.0, 3.0), (4.0, 2.0), (1.0, 1.0)]


def test_no_item_begins_after_the_time():
    assert not list(side_by_side(math.sqrt, [4.0], minutes=0.0))


def test_an_error_of_a_measurement_is_raised():
    with pytest.raises(ValueError, match="domain"):
        list(side_by_side(math.sqrt, [-1.0]))


def _process(_: int) -> int:
    return os.getpid()
