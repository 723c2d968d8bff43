"""Bending of a rod: what holds the nodes of its centre line as they are at rest, and damps how their curvature changes.

The discrete curvature of node i, between pieces of lengths h_i and h_i+1, is the difference of their unit directions,
t = (x_i+1 - x_i) / h_i+1 - (x_i - x_i-1) / h_i: the curvature vector times the length H = (h_i + h_i+1) / 2 that the
node stands for. At an angle phi between pieces that do not stretch its length is 2 sin(phi / 2), where the curvature
binormal of a discrete elastic rod (Bergou et al., ACM Trans. Graphics 27 (2008) 63), perpendicular to it and to the
line, has 2 tan(phi / 2). A node stores EI |t|^2 / 2H, which is that rod's bending energy to second order in phi. A
material that is damped as Kelvin and Voigt's resists dt/dt across the line in the same way. Intrinsic curvature and
twist add forces that are found once a frame of the rollout (`material_frames.py`).
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from egophys_core.kinds.rod_curve import fastest_bending
from egophys_core.lanes import Lanes, pack
from egophys_core.lanes.state import StateArrays
from egophys_core.simulation.batch import Rods
from egophys_core.simulation.terms.material_frames import FRAME_NUMBERS, RodArrays
from egophys_core.twin import PhysicalParameters, level_axes

TORSION_RATIO = 2.0 / 3.0
"""GJ / EI of a round rod of a material that keeps its volume."""


@wp.func
def discrete_curvature(
    group: int, node: int, axis: int, back: Lanes, onward: Lanes, of: wp.array3d(dtype=Lanes)
) -> Lanes:
    """A coordinate of a node's discrete curvature, for pieces of inverse lengths 1/m; of its rate with velocities."""
    here = of[group, node, axis]
    return wp.cw_mul(onward, of[group, node + 1, axis] - here) - wp.cw_mul(back, here - of[group, node - 1, axis])


@wp.func
def add_bending_forces(
    group: int,
    first: int,
    last: int,
    nodes: int,
    state: StateArrays,
    rods: RodArrays,
    forces: wp.array3d(dtype=Lanes),
):
    """Add forces of curvature at nodes first..last-1 to these and their neighbours, and what is held for a frame, N."""
    rigidity = rods.rigidity[group]
    viscosity = rods.viscosity[group]
    for node in range(first, last):
        for axis in range(3):
            forces[group, node, axis] += rods.forces[group, node, axis]
    one = Lanes(1.0)
    for node in range(wp.max(first, 1), wp.min(last, nodes - 1)):
        length = rods.lengths[group, node - 1]
        next_length = rods.lengths[group, node]
        back = wp.cw_div(one, length)
        onward = wp.cw_div(one, next_length)
        stood_for = 0.5 * (length + next_length)
        stiff = wp.cw_div(rigidity, stood_for)
        viscous = wp.cw_div(viscosity, stood_for)
        # Curvature that changes along the line is that of what is bent and rotates as one piece; it is not damped.
        along = Lanes()
        squared = Lanes()
        for axis in range(3):
            chord = state.positions[group, node + 1, axis] - state.positions[group, node - 1, axis]
            squared += wp.cw_mul(chord, chord)
            along += wp.cw_mul(chord, discrete_curvature(group, node, axis, back, onward, state.velocities))
        along = wp.cw_div(along, squared)
        for axis in range(3):
            chord = state.positions[group, node + 1, axis] - state.positions[group, node - 1, axis]
            rate = discrete_curvature(group, node, axis, back, onward, state.velocities) - wp.cw_mul(along, chord)
            moment = wp.cw_mul(stiff, discrete_curvature(group, node, axis, back, onward, state.positions))
            moment += wp.cw_mul(viscous, rate)
            forces[group, node - 1, axis] -= wp.cw_mul(back, moment)
            forces[group, node, axis] += wp.cw_mul(back + onward, moment)
            forces[group, node + 1, axis] -= wp.cw_mul(onward, moment)


def rod_bending(
    parameters: Sequence[PhysicalParameters],
    lengths: np.ndarray,
    masses: np.ndarray,
    directions: np.ndarray,
    far_clamps: np.ndarray,
    uneven: np.ndarray,
) -> Rods:
    """The bending of K rods.

    Args:
        lengths: [K, N - 1] metres of the pieces between nodes.
        masses: [K, N] kg.
        directions: [K, 3] from the first node to the last of the straight rod, in the world.
        far_clamps: [K] whether a clamp holds the last node.
        uneven: [K, N, 2] 1/m, intrinsic curvature at the nodes beyond that of the parameters.
    """
    stiff = np.array([each.flexural_rigidity for each in parameters])
    viscous = stiff * np.array([each.retardation_time for each in parameters])
    axes = np.array([level_axes(direction) for direction in directions])
    even = np.array([[each.intrinsic_curvature_level, each.intrinsic_curvature_up] for each in parameters])
    fastest = np.array([fastest_bending(*each) for each in zip(lengths, masses, strict=True)])
    return Rods(
        rigidity=stiff,
        viscosity=viscous,
        torsion=TORSION_RATIO * stiff,
        far_clamps=np.asarray(far_clamps, bool),
        curvatures=np.einsum("knb,kbi->kni", even[:, None] + uneven, axes[:, 1:]),
        far_rolls=np.array([each.far_roll for each in parameters]),
        axes=axes[:, 0],
        lengths=lengths,
        rates=np.stack([fastest * stiff, fastest * viscous], axis=1),
    )


def rod_arrays(rods: Rods | None, device: str) -> RodArrays:
    """Rods on a device, with material frames that are not turned yet; nothing to bend if there are none."""
    arrays = RodArrays()
    if rods is None:
        return arrays
    arrays.bend = 1
    for name in ("rigidity", "viscosity", "torsion", "far_clamps", "curvatures", "far_rolls", "axes", "lengths"):
        setattr(arrays, name, wp.array(pack(getattr(rods, name)), dtype=Lanes, device=device))
    shape = (arrays.rigidity.shape[0], rods.lengths.shape[1] + 1)
    arrays.forces = wp.zeros((*shape, 3), dtype=Lanes, device=device)
    arrays.material_frames = wp.zeros((*shape, FRAME_NUMBERS), dtype=Lanes, device=device)
    return arrays
