"""Model predictive path integral planning of waypoints to a target shape (Williams et al. 2016).

The plan is a nominal sequence of steps between free waypoints after the grasp. Each iteration adds Gaussian
noise to it, asks the forward model what every sample costs, and moves the nominal sequence to the average of
the samples weighted by exp(-cost / lambda).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from egophys_core.errors import PlanningError
from egophys_core.planning.grasp import Grasp
from egophys_core.planning.options import PlanOptions
from egophys_core.waypoint_plan import OPEN, POINTING_DOWN, WaypointPlan

ForwardModel = Callable[[Sequence[WaypointPlan]], np.ndarray]
"""Costs [K] in metres of K plans; infinity for a plan that cannot be simulated."""

Progress = Callable[[int, int, float], None]
"""Called with iterations done, iterations, best cost in metres; may raise to stop."""

FINGERTIP_M = 0.015
"""Metres: fingers that are moved by less still hold the same of the object."""


def plan_to_target(
    forward: ForwardModel,
    grasp: Grasp,
    options: PlanOptions,
    *,
    seed: int,
    twin_id: str = "",
    progress: Progress = lambda done, total, cost: None,
) -> tuple[WaypointPlan, float]:
    """Plan where to move the grasped object; the same seed gives the same plan.

    Returns:
        The cheapest plan met, with its predicted cost, and the cost of grasping without moving, metres.

    Raises:
        PlanningError: the grasp is over a fingertip outside the tool's box, or every sample of an iteration failed.
    """
    grasp = _reachable(grasp, options)
    generator = np.random.default_rng(seed)
    nominal = np.zeros((options.waypoints, 3))
    still = _plan(nominal, grasp, options, twin_id)
    initial_cost = float(forward([still])[0])
    best = replace(still, predicted_cost=initial_cost)
    noise_m = options.noise_m
    for iteration in range(options.iterations):
        noise = noise_m * generator.standard_normal((options.samples, options.waypoints, 3))
        noise[0] = 0.0
        samples = np.stack([_feasible(nominal + each, grasp, options) for each in noise])
        plans = [_plan(sample, grasp, options, twin_id) for sample in samples]
        costs = forward(plans)
        costs = np.where(np.isfinite(costs), costs, np.inf)
        if not np.isfinite(costs).any():
            raise PlanningError(f"every sample of iteration {iteration} failed in the forward model; lower noise_m")
        cheapest = int(np.argmin(costs))
        if costs[cheapest] < best.predicted_cost:
            best = replace(plans[cheapest], predicted_cost=float(costs[cheapest]))
        nominal = np.tensordot(_weights(costs, options.temperature), samples, axes=1)
        noise_m *= options.noise_decay
        progress(iteration + 1, options.iterations, best.predicted_cost)
    return best, initial_cost


def _reachable(grasp: Grasp, options: PlanOptions) -> Grasp:
    """The grasp with the tool inside its box; what lies on the table is often taken hold of right at the box's side."""
    low, high = np.array(options.low_m), np.array(options.high_m)
    inside = np.clip(grasp.position, low, high)
    if np.linalg.norm(inside - grasp.position) > FINGERTIP_M:
        raise PlanningError(
            f"the grasp at {np.round(grasp.position, 3).tolist()} m is outside the tool's box "
            f"{low.tolist()} .. {high.tolist()} m; move the object or widen the box"
        )
    return replace(grasp, position=inside)


def _weights(costs: np.ndarray, temperature: float) -> np.ndarray:
    """exp(-(S - min S) / lambda), normalised, with lambda the temperature times the spread of finite costs."""
    finite = costs[np.isfinite(costs)]
    spread = max(float(finite.std()), 1e-12)
    weights = np.where(np.isfinite(costs), np.exp(-(costs - finite.min()) / (temperature * spread)), 0.0)
    return np.asarray(weights / weights.sum())


def _feasible(steps: np.ndarray, grasp: Grasp, options: PlanOptions) -> np.ndarray:
    """Steps [W, 3] shortened to the speed limit and clipped so that every waypoint is in the tool's box."""
    longest = options.max_speed_m_s * options.segment_s
    length = np.linalg.norm(steps, axis=1, keepdims=True)
    steps = steps * np.minimum(1.0, longest / np.maximum(length, 1e-12))
    # The tool does not go below its grasp: the fingers would meet the table.
    low = np.maximum(options.low_m, [-np.inf, -np.inf, grasp.position[2]])
    feasible, position = np.empty_like(steps), grasp.position
    for index, step in enumerate(steps):
        target = np.clip(position + step, low, options.high_m)
        feasible[index], position = target - position, target
    return feasible


def _plan(steps: np.ndarray, grasp: Grasp, options: PlanOptions, twin_id: str) -> WaypointPlan:
    """Come from above, close on arrival, wait for the fingers, follow the steps, hold still."""
    path = grasp.position + np.cumsum(steps, axis=0)
    above = grasp.position + [0.0, 0.0, options.approach_m]
    closed_at = options.approach_s + options.grip_s
    times = [
        0.0,
        options.approach_s,
        closed_at,
        *(closed_at + options.segment_s * np.arange(1, len(steps) + 1)),
    ]
    positions = [above, grasp.position, grasp.position, *path]
    if options.settle_s > 0:
        times, positions = [*times, times[-1] + options.settle_s], [*positions, path[-1]]
    opening = np.zeros(len(times))
    opening[0] = OPEN
    return WaypointPlan(
        # Whole nanoseconds, as messages carry them, so that a plan is the same before and after sending.
        times=np.rint(np.array(times) * 1e9) / 1e9,
        positions=np.array(positions),
        quaternions=np.repeat(POINTING_DOWN[None], len(times), axis=0),
        gripper_opening=opening,
        twin_id=twin_id,
        predicted_cost=float("nan"),
    )
