"""Where a plan begins, as text: clouds that are no shape of the object are refused."""

import numpy as np
import pytest

from egophys_core.errors import PlanningError
from egophys_core.planning import start_of_source
from tests.effects.situations import sheet
from tests.experiments.twins import twin_of


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.full((50, 3), np.nan), "start .*cloud.npy: 50 of 50 points are not finite, point 0 the first"),
        (np.full((50, 3), np.inf), "start .*cloud.npy: 50 of 50 points are not finite"),
        (np.zeros((0, 3)), "start .*cloud.npy has no points"),
        (np.full((4, 3), 400.0), "start .*cloud.npy is .* m from the object, .*divide millimetres by 1000"),
        (np.zeros((4, 2)), r"start .*cloud.npy must be \[P, 3\] points in metres"),
        (None, "cannot read start .*cloud.npy"),
    ],
)
def test_a_cloud_that_is_no_start_is_refused(tmp_path, points, reason):
    path = tmp_path / "cloud.npy"
    if points is not None:
        np.save(path, points)
    with pytest.raises(PlanningError, match=reason):
        start_of_source(str(path), twin_of(sheet()))
