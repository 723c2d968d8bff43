"""MPPI on an analytic forward model: the object is where the tool ends."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from egophys_core.errors import OptionsError, PlanningError
from egophys_core.planning import Grasp, PlanOptions, plan_to_target
from egophys_core.planning.mppi import _weights
from egophys_core.waypoint_plan import WaypointPlan

GRASP = Grasp(position=np.array([0.0, 0.0, 0.01]), controllers=np.zeros((1, 3)))
OPTIONS = PlanOptions(waypoints=4, samples=24, iterations=15)


class EndsAt:
    """Costs the distance of the last waypoint to a point, and keeps every plan it was asked about."""

    def __init__(self, target: Sequence[float]) -> None:
        self.target = np.array(target)
        self.plans: list[WaypointPlan] = []

    def __call__(self, plans: Sequence[WaypointPlan]) -> np.ndarray:
        self.plans += plans
        return np.array([np.linalg.norm(plan.positions[-1] - self.target) for plan in plans])


def test_plan_ends_near_the_target():
    forward = EndsAt([0.1, -0.15, 0.12])
    plan, before = plan_to_target(forward, GRASP, OPTIONS, seed=0)
    assert before == pytest.approx(np.linalg.norm([0.1, -0.15, 0.11]))
    assert plan.predicted_cost < 0.15 * before
    assert plan.predicted_cost == forward([plan])[0]


def test_each_iteration_costs_one_call_of_all_samples_and_the_best_never_gets_worse():
    forward, reports = EndsAt([0.1, 0.1, 0.1]), []
    plan, before = plan_to_target(forward, GRASP, OPTIONS, seed=3, progress=lambda *each: reports.append(each))
    assert len(forward.plans) == 1 + OPTIONS.samples * OPTIONS.iterations
    costs = [cost for _, _, cost in reports]
    assert [done for done, _, _ in reports] == list(range(1, 16))
    assert costs == sorted(costs, reverse=True)
    assert costs[0] <= before
    assert costs[-1] == plan.predicted_cost


def test_same_seed_gives_the_same_plan_and_another_seed_another():
    one, same, other = (plan_to_target(EndsAt([0.1, 0, 0.1]), GRASP, OPTIONS, seed=seed)[0] for seed in (5, 5, 6))
    assert np.array_equal(one.positions, same.positions)
    assert one.predicted_cost == same.predicted_cost
    assert not np.array_equal(one.positions, other.positions)


def test_every_sample_stays_in_the_box_above_the_grasp_and_below_the_speed_limit():
    options = dataclasses.replace(
        OPTIONS, noise_m=0.3, max_speed_m_s=0.15, low_m=(-0.05, -0.1, 0.0), high_m=(0.1, 0.05, 0.2)
    )
    forward = EndsAt([1.0, 1.0, -1.0])
    plan_to_target(forward, GRASP, options, seed=0)
    for plan in forward.plans:
        motion = plan.positions[1:]
        assert (motion >= np.array([-0.05, -0.1, 0.01]) - 1e-9).all()
        assert (motion <= np.array([0.1, 0.05, 0.2]) + 1e-9).all()
        speed = np.linalg.norm(np.diff(motion, axis=0), axis=1) / np.diff(plan.times[1:])
        assert speed.max() <= 0.15 * (1 + 1e-6)
    reached = np.array([plan.positions[-1] for plan in forward.plans])
    assert reached[:, 0].max() == pytest.approx(0.1)


def test_every_plan_approaches_from_above_closes_waits_moves_and_settles():
    forward = EndsAt([0.1, 0, 0.1])
    plan_to_target(forward, GRASP, OPTIONS, seed=0, twin_id="abc")
    for plan in forward.plans:
        assert plan.times == pytest.approx([0, 2.0, 2.5, 3.1, 3.7, 4.3, 4.9, 5.9])
        assert plan.positions[0] == pytest.approx([0, 0, 0.11])
        assert plan.positions[1] == pytest.approx(GRASP.position)
        assert plan.positions[2] == pytest.approx(GRASP.position)
        assert (plan.positions[-1] == plan.positions[-2]).all()
        assert plan.gripper_opening.tolist() == [0.08, 0, 0, 0, 0, 0, 0, 0]
        assert plan.quaternions == pytest.approx(np.tile([1.0, 0, 0, 0], (8, 1)))
        assert plan.twin_id == "abc"


def test_times_are_whole_nanoseconds():
    options = dataclasses.replace(OPTIONS, segment_s=1 / 3, settle_s=0.0)
    plan, _ = plan_to_target(EndsAt([0.1, 0, 0.1]), GRASP, options, seed=0)
    assert len(plan.times) == 3 + OPTIONS.waypoints
    assert [round(time * 1e9) / 1e9 for time in plan.times] == plan.times.tolist()


def test_samples_that_fail_are_left_out_of_the_average():
    inner = EndsAt([0.1, 0.1, 0.1])

    def sometimes(plans: Sequence[WaypointPlan]) -> np.ndarray:
        costs = inner(plans)
        costs[1::2] = np.inf
        return costs

    plan, before = plan_to_target(sometimes, GRASP, OPTIONS, seed=0)
    assert np.isfinite(plan.positions).all()
    assert plan.predicted_cost < 0.5 * before


def test_all_samples_failing_is_an_error():
    def broken(plans: Sequence[WaypointPlan]) -> np.ndarray:
        return np.full(len(plans), np.inf)

    with pytest.raises(PlanningError, match="every sample of iteration 0 failed in the forward model; lower noise_m"):
        plan_to_target(broken, GRASP, OPTIONS, seed=0)


def test_costs_that_are_not_numbers_count_as_failed():
    def nan(plans: Sequence[WaypointPlan]) -> np.ndarray:
        return np.full(len(plans), np.nan)

    with pytest.raises(PlanningError, match="every sample of iteration 0 failed"):
        plan_to_target(nan, GRASP, OPTIONS, seed=0)


def test_some_costs_that_are_not_numbers_do_not_hide_the_others():
    inner = EndsAt([0.1, 0.1, 0.1])

    def sometimes(plans: Sequence[WaypointPlan]) -> np.ndarray:
        costs = inner(plans)
        costs[1::2] = np.nan
        return costs

    plan, before = plan_to_target(sometimes, GRASP, OPTIONS, seed=0)
    assert plan.predicted_cost < 0.5 * before


def test_object_that_cannot_be_held_still_is_planned_for():
    # Without moving the twin diverges; the samples do not.
    inner = EndsAt([0.1, 0.1, 0.1])

    def forward(plans: Sequence[WaypointPlan]) -> np.ndarray:
        return np.full(1, np.inf) if len(plans) == 1 else inner(plans)

    plan, before = plan_to_target(forward, GRASP, OPTIONS, seed=0)
    assert before == np.inf
    assert np.isfinite(plan.predicted_cost)


def test_grasp_outside_the_box_is_refused_with_both():
    outside = Grasp(position=np.array([1.0, 0, 0.01]), controllers=np.zeros((1, 3)))
    with pytest.raises(PlanningError, match=r"grasp at \[1.0, 0.0, 0.01\] m is outside the tool's box .*widen the box"):
        plan_to_target(EndsAt([0, 0, 0]), outside, OPTIONS, seed=0)


def test_grasp_right_under_the_box_is_taken_from_inside_it():
    under = Grasp(position=np.array([0.0, 0.0, -0.008]), controllers=np.zeros((1, 3)))
    plan, _ = plan_to_target(EndsAt([0.1, 0.1, 0.1]), under, OPTIONS, seed=0)
    assert plan.positions[:, 2].min() == OPTIONS.low_m[2]


def test_weights_are_those_of_the_softmin():
    # exp(-(S - min S) / lambda) with lambda = temperature * standard deviation of (1, 2, 3).
    costs = np.array([1.0, 2.0, 3.0, np.inf])
    factor = 1 / (0.5 * np.std([1, 2, 3]))
    expected = np.array([1.0, np.exp(-factor), np.exp(-2 * factor), 0.0])
    assert _weights(costs, 0.5) == pytest.approx(expected / expected.sum())
    assert _weights(np.ones(4), 0.5) == pytest.approx(np.full(4, 0.25))


@pytest.mark.parametrize(
    "change", [{"waypoints": 0}, {"samples": 1}, {"max_speed_m_s": 0.0}, {"noise_decay": 1.5}, {"segment_s": -1.0}]
)
def test_options_out_of_range_are_refused(change):
    with pytest.raises(OptionsError, match=f"{next(iter(change))} must be in"):
        dataclasses.replace(OPTIONS, **change)


def test_box_whose_corners_are_exchanged_is_refused():
    with pytest.raises(OptionsError, match="low_m"):
        PlanOptions(low_m=(0.2, 0.4, 0.5), high_m=(-0.2, -0.4, 0.0))
