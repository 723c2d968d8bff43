"""Detection limits: they follow slopes and noise, and say what looks alike."""

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.hypotheses.detection_limits import detection_limits
from egophys_core.diagnosis.hypotheses.ranking import Probe
from egophys_core.effects import LIBRARY

SHAPE = (30, 12, 3)
NEEDED = 40.0


def drawn(seed, size):
    return np.random.default_rng(seed).normal(0.0, size, SHAPE)


def probe(name, slopes, **start):
    effect = LIBRARY[name]
    values = {each.name: (each.null or 0.0) + each.step for each in effect.parameters}
    return Probe(effect=effect, start={**values, **start}, slopes=slopes)


def drag(size, seed=1):
    """What a step of drag does in two episodes, metres."""
    return probe("quadratic_drag", [drawn(seed, size)[..., None], drawn(seed + 1, size)[..., None]])


def gravity(slopes):
    return probe("gravity_scale", slopes)


def limits(*probes, noise=1e-3, baseline=None, needed=NEEDED):
    found = [drawn(10, noise), drawn(11, noise)]
    jacobian = baseline or [np.zeros((*SHAPE, 0))] * 2
    found = detection_limits(linear_problem(found, jacobian, noise), probes, needed_gain=needed)
    return {each.effect: each for each in found}


def test_what_shows_twice_as_much_is_seen_at_half_the_size():
    once, twice = (limits(drag(size))["quadratic_drag"].size for size in (1e-4, 2e-4))
    assert once == pytest.approx(2.0 * twice, rel=0.15)


def test_with_twice_the_noise_it_must_be_twice_as_large():
    quiet, loud = (limits(drag(2e-4), noise=noise)["quadratic_drag"].size for noise in (1e-3, 2e-3))
    assert loud == pytest.approx(2.0 * quiet, rel=0.15)


def test_at_its_limit_an_effect_gains_what_is_needed():
    size = limits(drag(2e-4))["quadratic_drag"].size
    step = next(each.step for each in LIBRARY["quadratic_drag"].parameters if each.name == "coefficient")
    changed = sum(np.sum((each * size / step) ** 2) for each in drag(2e-4).slopes) / 1e-3**2
    # Half the second derivative of Cauchy's loss, over residuals of the noise; three components say the same.
    residual = np.random.default_rng(0).normal(size=100_000)
    bend = np.mean((1.0 - residual**2) / (1.0 + residual**2) ** 2)
    assert changed * bend / 3.0 == pytest.approx(NEEDED, rel=0.15)


def test_what_the_objects_own_parameters_take_up_is_not_seen():
    hidden = drag(2e-4)
    free = limits(hidden)["quadratic_drag"].size
    found = limits(hidden, baseline=[each * 5.0 for each in hidden.slopes])
    assert found["quadratic_drag"].size is None or found["quadratic_drag"].size > 5.0 * free


def test_what_does_nothing_is_seen_in_no_size():
    assert limits(drag(0.0))["quadratic_drag"].size is None


def test_effects_that_do_the_same_are_alike_and_others_are_not():
    own = drag(2e-4)
    both = limits(own, gravity([0.5 * each for each in own.slopes]))
    assert both["quadratic_drag"].alike == ("gravity_scale",)
    assert both["gravity_scale"].alike == ("quadratic_drag",)
    apart = limits(own, gravity(drag(2e-4, seed=5).slopes))
    assert apart["quadratic_drag"].alike == apart["gravity_scale"].alike == ()


def test_of_several_starts_the_middle_one_counts():
    middle = limits(drag(2e-4))["quadratic_drag"]
    assert limits(drag(1e-5), drag(2e-4), drag(2e-3))["quadratic_drag"] == middle


def attained_limits(gain, *probes):
    """With refits that attain a gain at each number of steps."""
    found, jacobian = [drawn(10, 1e-3), drawn(11, 1e-3)], [np.zeros((*SHAPE, 0))] * 2
    limits = detection_limits(
        linear_problem(found, jacobian, 1e-3),
        probes,
        needed_gain=NEEDED,
        attained=lambda injected: [gain(each.steps) for each in injected],
    )
    return {each.parameter: each.size for each in limits}


def test_where_a_twin_bends_the_limit_is_moved_to_where_refits_gain_enough():
    own = drag(2e-4)
    step = next(each.step for each in LIBRARY["quadratic_drag"].parameters if each.name == "coefficient")
    by_slopes = limits(own)["quadratic_drag"].size
    steps = 3.0 * by_slopes / step
    found = attained_limits(lambda there: NEEDED * (there / steps) ** 2, own)
    assert found["coefficient"] == pytest.approx(3.0 * by_slopes, rel=0.05)


def test_what_a_twin_can_bend_to_at_any_size_is_never_seen():
    assert attained_limits(lambda there: NEEDED / 3.0, drag(2e-4)) == {"coefficient": None}


def test_what_cannot_be_simulated_keeps_what_slopes_say():
    own = drag(2e-4)
    assert attained_limits(lambda there: None, own)["coefficient"] == limits(own)["quadratic_drag"].size


def test_all_sizes_of_an_effect_move_with_the_one_that_shows_least():
    slopes = [
        np.stack([drawn(seed + part, size) for part, size in enumerate((4e-4, 2e-4, 1e-4))], -1) for seed in (1, 4)
    ]
    force = probe("constant_body_force", slopes)
    before, after = (
        {each: limits_of[each] for each in "xyz"}
        for limits_of in (
            attained_limits(lambda there: None, force),
            attained_limits(lambda there: 4.0 * NEEDED, force),
        )
    )
    assert before["x"] < before["y"] < before["z"]
    moved = [after[each] / before[each] for each in "xyz"]
    assert moved == pytest.approx([moved[0]] * 3, rel=0.01)
    assert moved[0] < 0.7


def test_a_size_that_is_never_seen_stays_so_beside_one_that_is():
    slopes = [np.stack([drawn(seed, 2e-4), drawn(seed, 0.0), drawn(seed + 1, 1e-4)], -1) for seed in (1, 4)]
    found = attained_limits(lambda there: 4.0 * NEEDED, probe("constant_body_force", slopes))
    assert found["y"] is None
    assert found["x"] is not None
    assert found["z"] is not None
