"""A small cloth lifted at a corner: the episode that the node tests build twins from, and plans for it."""

import numpy as np

from egophys_core.episode import Episode
from egophys_core.identification import FitOptions, build
from egophys_core.planning import Grasp
from egophys_core.twin import Twin
from egophys_core.waypoint_plan import POINTING_DOWN, WaypointPlan

NAME = "cloth"
SEED = 5
OPTIONS = FitOptions(generations=3, population=4, dense_steps=1)
OPTIONS_JSON = '{"generations": 3, "population": 4, "dense_steps": 1}'
ENDLESS_JSON = '{"generations": 10000}'
"""A build that takes minutes, to be stopped."""

FRAMES, SIDE, SPACING, HEIGHT = 40, 6, 0.03, 0.005


def cloth_episode() -> Episode:
    """40 frames at 30 Hz of 36 points on a square of 15 cm; a hand of three points lifts a corner by 10 cm."""
    line = (np.arange(SIDE) - (SIDE - 1) / 2) * SPACING
    x, y = np.meshgrid(line, line, indexing="ij")
    rest = np.stack([x.ravel(), y.ravel(), np.full(SIDE * SIDE, HEIGHT)], axis=1)
    times = np.arange(FRAMES) / 30
    lift = 0.1 * np.clip((times - 0.2) / 0.8, 0, 1)[:, None, None] * [-0.3, 0.0, 1.0]
    corner = line[-1]
    share = np.exp(-((rest[:, :2] - corner) ** 2).sum(axis=1) / (2 * 0.05**2))
    fingers = np.array([[corner, corner], [corner - 0.01, corner], [corner, corner - 0.01]])
    hand = np.column_stack([fingers, np.full(3, 2 * HEIGHT)])
    return Episode(
        name=NAME,
        times=times,
        points=(rest + lift * share[:, None]).astype(np.float32),
        confidence=np.ones((FRAMES, len(rest)), np.float32),
        point_ids=np.arange(len(rest), dtype=np.uint32),
        controllers=(hand + lift).astype(np.float32),
        controller_ids=np.arange(3, dtype=np.uint32),
    )


def cloth_twin(episode: Episode) -> Twin:
    """The twin that a node builds with `OPTIONS_JSON` and `SEED`."""
    return build([episode], OPTIONS, seed=SEED)


def lifting_plan(grasp: Grasp, height: float, *, hold_s: float = 0.5, twin_id: str = "") -> WaypointPlan:
    """Close at the grasp, lift by `height` metres within 0.7 s, hold."""
    up = np.array([0.0, 0.0, 1.0])
    return WaypointPlan(
        times=np.array([0.0, 0.3, 1.0, 1.0 + hold_s]),
        positions=np.stack([grasp.position + each * up for each in (0.1, 0.0, height, height)]),
        quaternions=np.repeat(POINTING_DOWN[None], 4, axis=0),
        gripper_opening=np.array([0.08, 0.0, 0.0, 0.0]),
        twin_id=twin_id,
        predicted_cost=float("nan"),
    )
