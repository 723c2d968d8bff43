"""Gradients against central differences of the float64 reference, for each kind of input and of scene."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np
import pytest

from egophys_core.simulation import RolloutBatch
from egophys_core.simulation.gradients import Gradient, differentiate
from tests.reference.simulator import simulate
from tests.simulation.differences import central_differences, derivative, linear_loss, substeps_of
from tests.simulation.effect_terms import extra_force
from tests.simulation.gradient_scenes import bars_that_collide, in_the_air, on_the_table

RELATIVE = 1e-3
"""What the gradient may be off by, of the largest derivative of its kind."""

SPRINGS = ("stiffness", "damping", "rest_lengths", "longest_extensions")
HANDS = ("controller_stiffness", "controller_damping", "controls")
STARTS = ("positions", "velocities")
BODY = ("masses", "gravity", "drag")
TABLE = ("restitution", "friction", "ground_projection", "contact_height")
COLLISION = ("collision_restitution", "collision_friction")

SCENES: dict[str, Callable[[], RolloutBatch]] = {
    "in the air": in_the_air,
    "with effects": partial(in_the_air, effects=True),
    "on the table": on_the_table,
    "self-collision": bars_that_collide,
}
KINDS = {
    "in the air": (*SPRINGS, "compression_ratio", *HANDS, *STARTS, *BODY, "collision_friction"),
    "with effects": ("effects", "added_mass", "drag", "masses", "stiffness", "positions", "velocities"),
    "on the table": (*SPRINGS, "compression_ratio", *HANDS, *STARTS, *BODY, *TABLE),
    "self-collision": (*SPRINGS[:3], *STARTS, "masses", "gravity", *COLLISION),
}
"""What each scene depends on and is checked for."""


@cache
def differentiated(name: str) -> tuple[RolloutBatch, np.ndarray, np.ndarray, Gradient]:
    """Scene, substeps of its frames, weights of a random linear loss, and the gradient."""
    batch = SCENES[name]()
    shape = (len(batch.controls[0].times), *batch.positions.shape[1:])
    weights = np.random.default_rng(0).normal(0, 1, shape)
    result, losses, gradient = differentiate(batch, linear_loss(weights))
    result.raise_on_failure()
    substeps = substeps_of(batch)
    exact = simulate(batch, 0, substeps=substeps, extra=extra_force(batch, 0))
    assert losses[0] == pytest.approx(float((weights * exact).sum()), abs=1e-5)
    return batch, substeps, weights, gradient


@pytest.mark.parametrize(("scene", "kind"), [(scene, kind) for scene, kinds in KINDS.items() for kind in kinds])
def test_gradient_agrees_with_central_differences(scene, kind):
    batch, substeps, weights, gradient = differentiated(scene)
    found = derivative(gradient, kind, 0)
    exact = central_differences(batch, kind, 0, found.shape, weights, substeps)
    assert np.abs(exact).max() > 1e-5
    assert np.abs(found - exact).max() < RELATIVE * np.abs(exact).max()


def test_every_kind_of_input_is_checked():
    kinds = {kind for kinds in KINDS.values() for kind in kinds}
    gradient = differentiated("in the air")[3]
    # Frames and slides are checked with the effects that make them (test_effect_gradients.py, test_sliding_grips.py).
    elsewhere, no_derivatives = {"contact_threshold", "frames", "slides"}, {"parameters", "pulls"}
    assert kinds | elsewhere == {*vars(gradient), *gradient.parameters} - no_derivatives


def test_the_edge_of_the_contact_band_has_no_gradient():
    # Force projection is all or nothing: the threshold changes in which substeps it acts, in jumps.
    batch, substeps, weights, gradient = differentiated("on the table")
    assert gradient.parameters["contact_threshold"].tolist() == [0.0]
    assert central_differences(batch, "contact_threshold", 0, (1,), weights, substeps).tolist() == [0.0]


def test_what_does_not_act_has_no_gradient():
    gradient = differentiated("in the air")[3]
    # Friction acts on what a hand presses.
    untouched = {*TABLE, *COLLISION} - {"collision_friction"}
    assert all(gradient.parameters[name].tolist() == [0.0] for name in untouched)
    assert gradient.effects.tolist() == [[0.0]]
    # The longest extension matters only to springs that come to it.
    longest = differentiated("on the table")[3].longest_extensions[0]
    assert 0 < np.count_nonzero(longest) < len(longest)
    untouched = differentiated("self-collision")[3]
    assert not untouched.longest_extensions.any()
    assert untouched.controller_stiffness.tolist() == untouched.controller_damping.tolist() == [0.0]
