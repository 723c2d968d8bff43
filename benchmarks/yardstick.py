"""The simulator's yardstick: one rollout, one spring per thread with atomic adds, two launches a substep.

It is written here for comparison only, as simply as such kernels are usually written.
"""

import numpy as np
import warp as wp


@wp.kernel(enable_backward=False)
def add_spring_forces(
    positions: wp.array(dtype=wp.vec3),
    velocities: wp.array(dtype=wp.vec3),
    springs: wp.array2d(dtype=int),
    rest_lengths: wp.array(dtype=float),
    stiffness: float,
    damping: float,
    forces: wp.array(dtype=wp.vec3),
):
    """Elastic and dashpot force of one spring on its two nodes."""
    spring = wp.tid()
    i = springs[spring, 0]
    j = springs[spring, 1]
    offset = positions[j] - positions[i]
    length = wp.length(offset)
    force = stiffness * (length - rest_lengths[spring]) / wp.max(length, 1.0e-9) * offset
    force += damping * (velocities[j] - velocities[i])
    wp.atomic_add(forces, i, force)
    wp.atomic_sub(forces, j, force)


@wp.kernel(enable_backward=False)
def integrate(
    dt: float,
    mass: float,
    positions: wp.array(dtype=wp.vec3),
    velocities: wp.array(dtype=wp.vec3),
    forces: wp.array(dtype=wp.vec3),
):
    """Semi-implicit Euler for one node; clears its force."""
    node = wp.tid()
    velocities[node] = velocities[node] + dt * (forces[node] / mass + wp.vec3(0.0, 0.0, -9.81))
    positions[node] = positions[node] + dt * velocities[node]
    forces[node] = wp.vec3()


class Yardstick:
    """One object, ready to be advanced."""

    def __init__(self, positions: np.ndarray, springs: np.ndarray, rest_lengths: np.ndarray, mass: float) -> None:
        """Put positions [N, 3] m, springs [E, 2], rest lengths [E] m and the mass of a node, kg, on the CPU."""
        self._positions = wp.array(positions, dtype=wp.vec3, device="cpu")
        self._velocities = wp.zeros(len(positions), dtype=wp.vec3, device="cpu")
        self._forces = wp.zeros(len(positions), dtype=wp.vec3, device="cpu")
        self._springs = wp.array(springs, dtype=int, device="cpu")
        self._rest_lengths = wp.array(rest_lengths, dtype=float, device="cpu")
        self._mass = mass

    def advance(self, substeps: int, dt: float, stiffness: float, damping: float) -> None:
        """Do some substeps of dt seconds."""
        state = [self._positions, self._velocities]
        for _ in range(substeps):
            wp.launch(
                add_spring_forces,
                dim=len(self._springs),
                inputs=[*state, self._springs, self._rest_lengths, stiffness, damping, self._forces],
                device="cpu",
            )
            wp.launch(integrate, dim=len(self._forces), inputs=[dt, self._mass, *state, self._forces], device="cpu")
