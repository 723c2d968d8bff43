"""State and parameters of the rollouts as the kernels see them."""

import warp as wp

from egophys_core.simulation.lanes import LANES, Lanes


@wp.struct
class StateArrays:
    """Nodes 0..N-1 of the object, then the controller points N..N+C-1."""

    positions: wp.array3d(dtype=Lanes)
    """[G, N + C, 3] metres, world."""
    velocities: wp.array3d(dtype=Lanes)
    """[G, N + C, 3] m/s."""
    forces: wp.array3d(dtype=Lanes)
    """[G, N, 3] newtons; terms add to it, the integrator uses it up and leaves zeros."""
    node_count: int
    controller_count: int


@wp.struct
class ParameterArrays:
    """Numbers per rollout; all [G] but the masses."""

    masses: wp.array2d(dtype=Lanes)
    """[G, N] kg."""
    gravity: wp.array(dtype=Lanes)
    """m/s^2, downward."""
    drag: wp.array(dtype=Lanes)
    """1/s."""
    strain_limit: wp.array(dtype=Lanes)
    restitution: wp.array(dtype=Lanes)
    friction: wp.array(dtype=Lanes)
    ground_projection: wp.array(dtype=Lanes)
    contact_threshold: wp.array(dtype=Lanes)
    """Metres."""
    contact_height: wp.array(dtype=Lanes)
    """World z of a node's centre that touches the table, metres."""
    substeps: wp.array(dtype=Lanes)
    """Substeps per frame (a whole number)."""
    frame_duration: wp.array(dtype=Lanes)
    """Seconds."""


@wp.func
def substep_duration(group: int, substep: int, parameters: ParameterArrays) -> Lanes:
    """Seconds of this substep; 0 for a rollout that has done all its substeps of the frame."""
    duration = Lanes()
    for lane in range(LANES):
        count = parameters.substeps[group][lane]
        duration[lane] = wp.where(float(substep) < count, parameters.frame_duration[group][lane] / count, 0.0)
    return duration
