"""A twin as forward model."""

import dataclasses

import numpy as np
import pytest

from egophys_core.errors import PlanningError
from egophys_core.planning import (
    PlanOptions,
    carried_start,
    final_shapes,
    grasp_from_points,
    plan_to_target,
    rollout_plans,
    shape_costs,
    start_of_twin,
    twin_costs,
)
from tests.identification.synthetic import known_model
from tests.twin.examples import make_twin

OPTIONS = PlanOptions(waypoints=2, segment_s=0.4, settle_s=0.3, samples=8, iterations=4, noise_m=0.05)


@pytest.fixture(scope="module")
def twin():
    return make_twin(known_model(), ground_height=0.0)


def planned(twin, target, *, seed=0, options=OPTIONS):
    return plan_to_target(
        lambda plans: twin_costs(twin, plans, target), grasp_from_points(twin.grasp), options, seed=seed
    )


@pytest.fixture(scope="module")
def moved_shape(twin):
    """What the object looks like after a plan of another seed."""
    plan, _ = planned(twin, twin.model.graph.positions + np.float32([0.05, 0.05, 0.05]), seed=11)
    return plan, final_shapes(twin, rollout_plans(twin, [plan]))[0]


def test_planning_with_a_twin_lowers_the_cost(twin, moved_shape):
    _, target = moved_shape
    plan, before = planned(twin, target)
    assert plan.predicted_cost < 0.7 * before
    # The prediction is what the twin does under that plan, alone or among others.
    assert twin_costs(twin, [plan], target)[0] == plan.predicted_cost
    assert twin_costs(twin, [plan] * 9, target).tolist() == [plan.predicted_cost] * 9


def test_cost_is_nothing_for_the_plan_that_made_the_target(twin, moved_shape):
    plan, target = moved_shape
    assert twin_costs(twin, [plan], target).tolist() == [0.0]


def test_final_shapes_are_the_visible_nodes_at_the_end(twin, moved_shape):
    plan, _ = moved_shape
    graph = dataclasses.replace(twin.model.graph, surface=np.arange(25) < 20)
    hidden = dataclasses.replace(twin, model=dataclasses.replace(twin.model, graph=graph))
    result = rollout_plans(hidden, [plan])
    assert np.array_equal(final_shapes(hidden, result)[0], result.positions[0, -1, :20])


def test_plans_begin_where_the_object_is(twin, moved_shape):
    plan, shape = moved_shape
    aside = np.float32([0.3, -0.2, 0.0])
    start = carried_start(twin, twin.model.graph.positions + aside)
    assert start.grasp == pytest.approx(twin.grasp + aside, abs=1e-6)
    there = dataclasses.replace(plan, positions=plan.positions + aside)
    # Friction makes float32's last digits count.
    assert final_shapes(twin, rollout_plans(twin, [there], start=start))[0] == pytest.approx(shape + aside, abs=2e-3)
    assert twin_costs(twin, [plan], shape, start=start_of_twin(twin)).tolist() == [0.0]


def test_the_grasp_goes_where_its_material_goes(twin):
    nodes = twin.model.graph.positions.copy()
    held = np.linalg.norm(nodes - twin.grasp.mean(axis=0), axis=1) < 0.09
    nodes[held] += np.float32([0.0, 0.05, 0.08])
    assert carried_start(twin, nodes).grasp == pytest.approx(twin.grasp + np.float32([0.0, 0.05, 0.08]), abs=1e-6)


def test_a_start_that_is_none_is_refused(twin, moved_shape):
    plan, _ = moved_shape
    own = start_of_twin(twin)
    with pytest.raises(PlanningError, match=rf"all 25 nodes of twin {twin.twin_id}, got \(24, 3\)"):
        rollout_plans(twin, [plan], start=dataclasses.replace(own, nodes=own.nodes[:-1]))
    with pytest.raises(PlanningError, match="the start must be finite"):
        rollout_plans(twin, [plan], start=dataclasses.replace(own, grasp=own.grasp * np.nan))


def test_held_corner_goes_where_the_tool_goes(twin, moved_shape):
    plan, shape = moved_shape
    corner = twin.model.graph.positions[-1]
    way = plan.positions[-1] - plan.positions[1]
    assert np.linalg.norm(way) > 0.03
    assert np.linalg.norm(shape[-1] - corner - way) < 0.35 * np.linalg.norm(way)


def test_shape_costs_by_hand():
    target = np.array([[0.0, 0, 0]])
    shapes = np.array([[[0.0, 0, 0], [3, 4, 0]], [[1.0, 0, 0], [1, 0, 0]], [[np.nan, 0, 0], [0, 0, 0]]])
    assert shape_costs(shapes, target).tolist() == [1.25, 1.0, np.inf]


@pytest.mark.parametrize("target", [np.zeros((0, 3)), np.zeros(3), np.full((2, 3), np.nan), np.zeros((2, 2))])
def test_target_that_is_no_shape_is_refused(target):
    with pytest.raises(PlanningError, match=r"the target must be \[P, 3\] finite points"):
        shape_costs(np.zeros((1, 4, 3)), target)


def test_no_plan_and_no_grasp_are_refused(twin, moved_shape):
    plan, _ = moved_shape
    with pytest.raises(PlanningError, match="no plan to roll out"):
        rollout_plans(twin, [])
    with pytest.raises(PlanningError, match="the twin has no grasp"):
        rollout_plans(dataclasses.replace(twin, grasp=np.zeros((0, 3), np.float32)), [plan])


def test_plan_that_is_not_finite_is_refused(twin, moved_shape):
    plan, _ = moved_shape
    broken = plan.positions.copy()
    broken[-1, 2] = np.nan
    with pytest.raises(PlanningError, match="finite poses"):
        rollout_plans(twin, [dataclasses.replace(plan, positions=broken)])
