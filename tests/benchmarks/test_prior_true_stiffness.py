"""The true stiffness of a spring is that of the elements where it lies, wherever the object lies."""

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.prior.objects import Shape, make_object
from benchmarks.prior.true_stiffness import log_stiffness
from benchmarks.prior.variations import Variation


def test_springs_of_a_hem_are_stiff_and_others_soft_where_the_towel_was_turned_and_seen_in_part():
    body = make_object(Shape.TOWEL, Variation.HEM, 5, points=80)
    turn = Rotation.from_rotvec([0.1, -0.2, 1.3]).as_matrix()
    lies = body.tracked(body.vertices) @ turn.T + [0.3, -0.1, 0.02]
    lies[::3] = np.nan
    stiff = body.stiffness_shares > 1.0
    middles = body.vertices[body.elements].mean(axis=1)
    springs = np.stack([middles - [0.0005, 0.0, 0.0], middles + [0.0005, 0.0, 0.0]], axis=1)
    found = log_stiffness(body, lies, springs @ turn.T + [0.3, -0.1, 0.02])
    assert np.mean((found > 0.0) == stiff) > 0.9
