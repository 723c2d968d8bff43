"""Controller points: they move as the hand or tool did, smoothly and with their velocity."""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import FrameArrays, StateArrays


@wp.struct
class ControllerArrays:
    """Motion of the controller points over one frame, per lane."""

    start_positions: wp.array3d(dtype=Lanes)
    """[G, C, 3] metres, at the frame's start."""
    end_positions: wp.array3d(dtype=Lanes)
    """[G, C, 3] metres, at its end."""
    start_velocities: wp.array3d(dtype=Lanes)
    """[G, C, 3] m/s, at its start."""
    end_velocities: wp.array3d(dtype=Lanes)
    """[G, C, 3] m/s, at its end."""


@wp.func
def hermite(p0: Lanes, p1: Lanes, v0: Lanes, v1: Lanes, share: Lanes, duration: Lanes) -> Lanes:
    """Cubic Hermite position at a share 0..1 of a frame of some duration, metres."""
    value = Lanes()
    for lane in range(LANES):
        t = share[lane]
        u = 1.0 - t
        tangents = t * u * duration[lane] * (u * v0[lane] - t * v1[lane])
        # p0 + weight (p1 - p0), so that a point that rests stays where it is to the last bit.
        value[lane] = p0[lane] + t * t * (3.0 - 2.0 * t) * (p1[lane] - p0[lane]) + tangents
    return value


@wp.func
def hermite_velocity(p0: Lanes, p1: Lanes, v0: Lanes, v1: Lanes, share: Lanes, duration: Lanes) -> Lanes:
    """Derivative of `hermite` by time, m/s."""
    value = Lanes()
    for lane in range(LANES):
        t = share[lane]
        chord = (p1[lane] - p0[lane]) / duration[lane]
        value[lane] = (
            6.0 * t * (1.0 - t) * chord + (1.0 - t) * (1.0 - 3.0 * t) * v0[lane] + t * (3.0 * t - 2.0) * v1[lane]
        )
    return value


@wp.func
def move_controllers(
    group: int,
    first: int,
    last: int,
    substep: int,
    controllers: ControllerArrays,
    frame: FrameArrays,
    after: StateArrays,
):
    """Put controller points first..last-1 where their recorded motion is at the end of the substep."""
    duration = frame.duration[group]
    substeps = frame.substeps[group]
    share = Lanes()
    for lane in range(LANES):
        share[lane] = wp.min(1.0, float(substep + 1) / substeps[lane])
    for controller in range(first, last):
        node = frame.node_count + controller
        for axis in range(3):
            p0 = controllers.start_positions[group, controller, axis]
            p1 = controllers.end_positions[group, controller, axis]
            v0 = controllers.start_velocities[group, controller, axis]
            v1 = controllers.end_velocities[group, controller, axis]
            after.positions[group, node, axis] = hermite(p0, p1, v0, v1, share, duration)
            after.velocities[group, node, axis] = hermite_velocity(p0, p1, v0, v1, share, duration)
