"""How the material frames of a rod are turned, against the least of the energy that says so, and the forces of that."""

import numpy as np
import pytest
import warp as wp
from scipy.optimize import minimize

from egophys_core.lanes import unpack
from egophys_core.simulation.device_arrays import state_arrays
from egophys_core.simulation.terms.material_frames import ANGLE, settle_material_frames
from egophys_core.simulation.terms.rod_bending import TORSION_RATIO, rod_arrays, rod_bending
from egophys_core.twin import level_axes
from tests.simulation.scenes import parameters

NODES, LENGTH, RIGIDITY = 12, 0.6, 0.01
"""Of pieces of equal length; metres; N m^2."""

PIECE = LENGTH / (NODES - 1)

UNEVEN = np.stack([np.linspace(-1.0, 1.0, NODES), np.cos(np.linspace(0.0, 6.0, NODES))], axis=1)
"""1/m, intrinsic curvature of the nodes beyond an even one."""

ROLL = 0.4
"""Radians, of the far clamp."""


def wound_line() -> np.ndarray:
    """[N, 3] metres: a line along x that sags, and goes to one side and the other."""
    angles = np.linspace(-1.1, 1.1, NODES)
    radius = LENGTH / 2.2
    line = np.stack([radius * np.sin(angles), 0.04 * np.sin(2.0 * angles), -radius * np.cos(angles)], axis=1)
    edges = np.diff(line, axis=0)
    steps = PIECE * edges / np.linalg.norm(edges, axis=1)[:, None]
    return np.concatenate([line[:1], line[0] + np.cumsum(steps, axis=0)])


def parallel_transport(first: np.ndarray, second: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """A vector after the smallest rotation of one direction into another."""
    axis = np.cross(first, second)
    return vector + np.cross(axis, vector) + np.cross(axis, np.cross(axis, vector)) / (1.0 + first @ second)


def energy(line: np.ndarray, angles: np.ndarray, axis: np.ndarray, curvatures: np.ndarray) -> float:
    """J: what twist stores less what the intrinsic curvature gives, with angles [N - 1] of the pieces.

    Args:
        curvatures: [N, 3] intrinsic ones of the nodes, 1/m.
    """
    edges = np.diff(line, axis=0)
    directions = edges / np.linalg.norm(edges, axis=1)[:, None]
    sides = [parallel_transport(axis, direction, level_axes(axis)[1]) for direction in directions]
    total = 0.0
    for node in range(len(edges) - 1):
        before, onward = directions[node], directions[node + 1]
        carried = parallel_transport(before, onward, sides[node])
        twist = np.arctan2(np.cross(carried, sides[node + 1]) @ onward, carried @ sides[node + 1])
        total += TORSION_RATIO * RIGIDITY * (angles[node + 1] - angles[node] + twist) ** 2 / (2.0 * PIECE)
        here = (before + onward) / np.linalg.norm(before + onward)
        intrinsic = parallel_transport(axis, here, curvatures[node + 1])
        middle = 0.5 * (angles[node] + angles[node + 1])
        intrinsic = np.cos(middle) * intrinsic + np.sin(middle) * np.cross(here, intrinsic)
        total -= RIGIDITY * (edges[node + 1] - edges[node]) @ intrinsic / PIECE
    return total


def at_rest(line: np.ndarray, axis: np.ndarray, curvatures: np.ndarray, far: bool) -> tuple[np.ndarray, float]:
    """[N - 1] angles of the pieces that store least, and how much that is."""
    free = slice(1, NODES - 2 if far else NODES - 1)
    angles = np.zeros(NODES - 1)
    angles[-1] = ROLL if far else 0.0

    def stored(some: np.ndarray) -> float:
        angles[free] = some
        return energy(line, angles, axis, curvatures) / RIGIDITY

    found = minimize(stored, np.zeros(NODES - 3 if far else NODES - 2), method="BFGS", options={"gtol": 1e-7})
    angles[free] = found.x
    return angles, float(found.fun * RIGIDITY)


def intrinsic_at_nodes(curvature: tuple[float, float], axes: np.ndarray) -> np.ndarray:
    """[N, 3] 1/m on the straight rod."""
    return (np.array(curvature) + UNEVEN) @ axes[1:]


def settled(line: np.ndarray, curvature: tuple[float, float], far: bool) -> tuple[np.ndarray, np.ndarray]:
    """[N - 1] angles of the pieces and [N, 3] forces on the nodes, N, as the simulator finds them in some frames."""
    level, up = curvature
    masses = np.full((1, NODES), 1e-3)
    rods = rod_bending(
        [
            parameters(
                flexural_rigidity=RIGIDITY, intrinsic_curvature_level=level, intrinsic_curvature_up=up, far_roll=ROLL
            )
        ],
        np.full((1, NODES - 1), PIECE),
        masses,
        line[None, -1] - line[None, 0],
        np.array([far]),
        UNEVEN[None],
    )
    arrays = rod_arrays(rods, "cpu")
    state = state_arrays(line[None], np.zeros((1, NODES, 3)), "cpu")
    for _ in range(5):
        wp.launch(settle_material_frames, 1, inputs=[NODES, state, arrays], device="cpu")
    return unpack(arrays.material_frames.numpy(), 1)[0, 1:, ANGLE], unpack(arrays.forces.numpy(), 1)[0]


@pytest.mark.parametrize("far", [True, False], ids=["two clamps", "a free end"])
@pytest.mark.parametrize("curvature", [(0.0, 0.0), (2.0, -1.0), (0.5, 3.0)])
def test_material_frames_are_turned_to_where_least_is_stored(curvature: tuple[float, float], far: bool) -> None:
    line = wound_line()
    axes = level_axes(line[-1] - line[0])
    expected, _ = at_rest(line, axes[0], intrinsic_at_nodes(curvature, axes), far)
    angles, _ = settled(line, curvature, far)
    assert np.abs(expected).max() > 0.01
    assert angles == pytest.approx(expected, abs=0.01 * np.abs(expected).max() + 1e-3)


@pytest.mark.parametrize(
    "curvature",
    [
        pytest.param((0.0, 0.0), id="twist alone", marks=pytest.mark.slow),
        pytest.param((2.0, -1.0), id="intrinsic curvature"),
    ],
)
def test_forces_are_the_slopes_of_what_is_stored(curvature: tuple[float, float]) -> None:
    """On nodes that are not a clamp's; those of one say how its material frame is held."""
    line = wound_line()
    axes = level_axes(line[-1] - line[0])
    intrinsic = intrinsic_at_nodes(curvature, axes)
    _, forces = settled(line, curvature, True)
    step = 1e-4
    for node in (3, 7):
        slopes = np.zeros(3)
        for coordinate in range(3):
            there, back = line.copy(), line.copy()
            there[node, coordinate] += step
            back[node, coordinate] -= step
            rise = at_rest(there, axes[0], intrinsic, True)[1] - at_rest(back, axes[0], intrinsic, True)[1]
            slopes[coordinate] = rise / (2.0 * step)
        assert forces[node] == pytest.approx(-slopes, abs=0.05 * np.abs(slopes).max())
