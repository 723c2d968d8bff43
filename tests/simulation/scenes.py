"""Small scenes to roll out: free nodes, springs and controllers, with one substep a frame where dt matters."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from egophys_core.simulation import Controls, RolloutBatch
from egophys_core.twin import ObjectModel, PhysicalParameters, SpringGraph, SpringKind, connect, per_kind

FAR_BELOW = -100.0
"""A table nobody reaches, metres."""


def frame_times(duration: float, dt: float) -> np.ndarray:
    """Times 0 .. duration in steps of dt; up to 1/600 s a frame of a soft scene is one substep."""
    return np.linspace(0.0, duration, round(duration / dt) + 1)


def idle_controls(times: np.ndarray) -> Controls:
    """One controller point that holds nothing."""
    return Controls(
        times=times, positions=np.zeros((len(times), 1, 3), np.float32), contact=np.zeros((len(times), 1), bool)
    )


def moving_controls(times: np.ndarray, path: np.ndarray, hold: np.ndarray | None = None) -> Controls:
    """Controllers along `path` [F, C, 3] (or [F, 3] for one) that hold all the time unless told otherwise."""
    path = np.asarray(path, np.float32).reshape(len(times), -1, 3)
    return Controls(times=times, positions=path, contact=np.ones(path.shape[:2], bool) if hold is None else hold)


def parameters(**changes: Any) -> PhysicalParameters:
    """No gravity, no friction, nothing damped: what a test does not name does not act."""
    quiet = {"stiffness": 1.0, "damping": 0.0, "controller_stiffness": 1.0, "friction": 0.0, "gravity": 0.0}
    return PhysicalParameters(**{**quiet, "strain_limit": 1e6, **changes})


def scene(
    positions: Sequence[Sequence[float]] | np.ndarray,
    controls: Controls,
    *,
    springs: Sequence[tuple[int, int]] | np.ndarray = (),
    stiffness: float = 1.0,
    damping: float = 0.0,
    rest_lengths: Sequence[float] | np.ndarray = (),
    mass: float = 1.0,
    velocities: Sequence[Sequence[float]] | np.ndarray | None = None,
    ground_height: float = FAR_BELOW,
    flat: bool = True,
    **changes: Any,
) -> RolloutBatch:
    """One rollout of nodes of equal mass; `damping` is also that of the controller springs."""
    start = np.asarray(positions, np.float32)[None]
    pairs = np.asarray(springs, np.int32).reshape(-1, 2)
    order = np.argsort(pairs[:, 0], kind="stable")
    pairs, lengths = pairs[order], np.asarray(rest_lengths, np.float32).reshape(1, -1)[:, order]
    alpha = parameters(damping=damping, **changes)
    return RolloutBatch(
        springs=pairs,
        stiffness=np.full((1, len(pairs)), stiffness, np.float32),
        damping=np.full((1, len(pairs)), damping, np.float32),
        rest_lengths=lengths,
        longest_extensions=np.float32(alpha.strain_limit) * lengths,
        masses=np.full(start.shape[:2], mass, np.float32),
        positions=start,
        velocities=np.zeros_like(start) if velocities is None else np.asarray(velocities, np.float32)[None],
        rest_positions=start[0],
        parameters=(alpha,),
        controls=(controls,),
        flat=flat,
        ground_height=ground_height,
    )


def sheet_positions(side: int = 4, spacing: float = 0.05, height: float = 0.0) -> np.ndarray:
    """[side^2, 3] float32 metres: a square grid around the origin, a little uneven."""
    axis = (np.arange(side) - (side - 1) / 2) * spacing
    x, y = np.meshgrid(axis, axis, indexing="ij")
    uneven = 0.02 * spacing * np.sin(np.arange(side * side))
    return np.stack([x.ravel() + uneven, y.ravel() - uneven, np.full(side * side, height)], axis=1).astype(np.float32)


def sheet_model(
    positions: np.ndarray | None = None,
    *,
    kind: str = "sheet",
    radius: float = 0.08,
    max_neighbours: int = 8,
    **changes: Any,
) -> ObjectModel:
    """A small object that a few simulated seconds can handle."""
    positions = sheet_positions() if positions is None else positions
    springs = connect(positions.astype(np.float64), radius=radius, max_neighbours=max_neighbours)
    ends = positions[springs].astype(np.float64)
    graph = SpringGraph(
        positions=positions,
        springs=springs,
        kinds=np.full(len(springs), SpringKind.STRUCTURAL, np.uint8),
        rest_lengths=np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).astype(np.float32),
        surface=np.ones(len(positions), bool),
    )
    numbers = {
        "total_mass": 0.1,
        "stiffness": 20.0,
        "damping": 0.02,
        "controller_stiffness": 20.0,
        "controller_radius": 0.06,
        "friction": 0.4,
        "drag": 0.1,
        **changes,
    }
    alpha = PhysicalParameters(**numbers)
    return ObjectModel(
        kind=kind, graph=graph, parameters=alpha, stiffness=per_kind(graph, alpha.stiffness, alpha.bending_ratio)
    )
