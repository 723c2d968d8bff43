"""Controller points: they move as the hand or tool did, smoothly and with their velocity."""

import warp as wp

from egophys_core.simulation.lanes import LANES, Lanes


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
            6.0 * t * (1.0 - t) * chord
            + (1.0 - t) * (1.0 - 3.0 * t) * v0[lane]
            + t * (3.0 * t - 2.0) * v1[lane]
        )
    return value
