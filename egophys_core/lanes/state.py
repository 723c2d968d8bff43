"""State and parameters of the rollouts as the kernels see them."""

import warp as wp

from egophys_core.lanes import LANES, Lanes

RUNNING = 2**30
"""In `FrameArrays.divergence`: this rollout has not diverged."""


@wp.struct
class StateArrays:
    """Nodes 0..N-1 of the object, then the controller points N..N+C-1."""

    positions: wp.array3d(dtype=Lanes)
    """[G, N + C, 3] metres, world."""
    velocities: wp.array3d(dtype=Lanes)
    """[G, N + C, 3] m/s."""
    memory: wp.array3d(dtype=Lanes)
    """[G, E, M] what springs remember of how they were strained, each law in slots of its own; 0 at the start."""


@wp.struct
class ParameterArrays:
    """Numbers per rollout; all [G] but the masses and their inverses, and what all rollouts share."""

    masses: wp.array2d(dtype=Lanes)
    """[G, N] kg."""
    inverse_masses: wp.array2d(dtype=Lanes)
    """[G, N] 1/kg."""
    gravity: wp.array(dtype=Lanes)
    """m/s^2, downward."""
    drag: wp.array(dtype=Lanes)
    """1/s."""
    added_mass: wp.array(dtype=Lanes)
    """Mass of the air that a thin object carries along its normal, over its own."""
    across: wp.array2d(dtype=int)
    """[N, 4] nodes across each node of a thin object; [0, 4] where nothing carries air."""
    compression_ratio: wp.array(dtype=Lanes)
    restitution: wp.array(dtype=Lanes)
    friction: wp.array(dtype=Lanes)
    ground_projection: wp.array(dtype=Lanes)
    contact_threshold: wp.array(dtype=Lanes)
    """Metres."""
    contact_height: wp.array(dtype=Lanes)
    """World z of a node's centre that touches the table, metres."""
    collision_restitution: wp.array(dtype=Lanes)
    collision_friction: wp.array(dtype=Lanes)


@wp.struct
class FrameArrays:
    """The frame that is being advanced."""

    node_count: int
    controller_count: int
    start: wp.array(dtype=Lanes)
    """[G] seconds, when the frame begins."""
    duration: wp.array(dtype=Lanes)
    """[G] seconds."""
    substeps: wp.array(dtype=Lanes)
    """[G] substeps in the frame (whole numbers)."""
    divergence: wp.array2d(dtype=int)
    """[G, LANES] substep * N + node where a rollout diverged in this frame or before it, else `RUNNING`."""


@wp.func
def substep_duration(group: int, substep: int, frame: FrameArrays) -> Lanes:
    """Seconds of this substep; 0 for a rollout that has done all its substeps of the frame or has diverged."""
    duration = Lanes()
    for lane in range(LANES):
        count = frame.substeps[group][lane]
        left = wp.where(float(substep) < count, frame.duration[group][lane] / count, 0.0)
        duration[lane] = wp.where(frame.divergence[group, lane] == RUNNING, left, 0.0)
    return duration


@wp.func
def substep_time(group: int, substep: int, frame: FrameArrays) -> Lanes:
    """Seconds since the start of the rollout at the beginning of this substep."""
    time = Lanes()
    for lane in range(LANES):
        # A lane may have no substeps in a frame.
        count = wp.max(frame.substeps[group][lane], 1.0)
        time[lane] = frame.start[group][lane] + float(substep) * frame.duration[group][lane] / count
    return time
