"""Rollouts to differentiate: forces are near one, as float32 would drown small differences of large ones.

Nothing in them hits the table, collides, or begins or stops to be pressed so near the end of a substep that the small
changes of `differences.STEPS` move it to another one.
"""

from dataclasses import replace

import numpy as np

from egophys_core.kinds.surface_faces import nodes_across
from egophys_core.simulation import ContactKind, Controls, RolloutBatch
from tests.simulation.effect_terms import gust_and_tether
from tests.simulation.scenes import scene

NONE, HOLD, PRESS = ContactKind.NONE, ContactKind.HOLD, ContactKind.PRESS


def net(generator: np.random.Generator, height: float = 0.0) -> np.ndarray:
    """[6, 3] metres: two rows of three nodes about 0.1 m apart."""
    grid = np.array([[0.1 * i, 0.1 * j, height] for i in range(3) for j in range(2)])
    return grid + generator.normal(0, 0.01, (6, 3)) * [1, 1, 0]


def lengths(positions: np.ndarray, springs: np.ndarray) -> np.ndarray:
    """[E] metres: distances of the springs' ends."""
    return np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1)


def in_the_air(*, effects: bool = False) -> RolloutBatch:
    """A net in free flight; some of its springs are at their longest extension, its frames differ in duration.

    Controller point 0 holds a node from the start and lets go, 1 takes hold in mid-flight, 2 presses a node and then
    holds it.
    """
    generator = np.random.default_rng(3)
    positions = net(generator) + generator.normal(0, 0.01, (6, 3)) * [0, 0, 1]
    springs = np.array([(0, 1), (0, 2), (0, 3), (1, 3), (2, 3), (2, 4), (3, 4), (3, 5), (4, 5)])
    times = np.array([0.0, 0.01, 0.03, 0.04, 0.06, 0.085])
    path = np.zeros((len(times), 3, 3))
    path[:, 0] = positions[0] + [-0.03, 0, 0.01] + times[:, None] * [-0.5, 0.2, 0.3]
    path[:, 1] = positions[5] + [0.02, 0.02, 0] + times[:, None] ** 2 * [3.0, 2.0, 0.3]
    # Away from the node as the press begins, then against it.
    path[:, 2] = positions[4] + [0.03, -0.02, 0] + np.array([0, 0, 3, -20, -35, -45])[:, None] * [1e-3, -3e-4, 2e-4]
    contact = np.array([[HOLD] * 3 + [NONE] * 3, [NONE] * 2 + [HOLD] * 4, [NONE] + [PRESS] * 3 + [HOLD] * 2])
    batch = scene(
        positions,
        Controls(times=times, positions=path.astype(np.float32), contact=contact.T.astype(np.uint8)),
        springs=springs,
        stiffness=12.0,
        damping=0.03,
        rest_lengths=lengths(positions, springs) * generator.uniform(0.6, 1.1, len(springs)),
        mass=0.02,
        velocities=generator.normal(0, 0.3, (6, 3)),
        gravity=9.81,
        drag=0.4,
        strain_limit=0.15,
        compression_ratio=0.6,
        controller_stiffness=15.0,
        controller_radius=0.09,
        controller_neighbours=2,
        collision_friction=0.2,
        flat=False,
    )
    if not effects:
        return batch
    return replace(
        batch,
        effects=gust_and_tether([[40.0, -60.0, 20.0, 0.0475]], [[1.5, 0.05]]),
        parameters=tuple(replace(each, added_mass=0.8) for each in batch.parameters),
        across=nodes_across(batch.rest_positions),
    )


def on_the_table() -> RolloutBatch:
    """A net that lands, slides with friction and is dragged; one node drops later and bounces.

    Controller point 0 drags its node along the table, 1 takes hold of another and lifts it through the contact band.
    """
    generator = np.random.default_rng(5)
    positions = net(generator, height=0.1034)
    positions[5, 2] += 0.001
    springs = np.array([(0, 1), (0, 2), (0, 3), (1, 3), (2, 3), (2, 4), (3, 4)])
    times = np.array([0.0, 0.02, 0.045, 0.07])
    path = np.zeros((len(times), 2, 3))
    path[:, 0] = positions[0] + [-0.03, 0, 0.01] + times[:, None] * [0.4, 0.2, 0]
    path[:, 1] = positions[4] + [0.02, 0.02, 0.02] + times[:, None] ** 2 * [3.0, 2.0, 10.0]
    contact = np.array([[HOLD] * 4, [NONE] + [HOLD] * 3])
    return scene(
        positions,
        Controls(times=times, positions=path.astype(np.float32), contact=contact.T.astype(np.uint8)),
        springs=springs,
        stiffness=8.0,
        damping=0.03,
        rest_lengths=lengths(positions, springs) * generator.uniform(0.9, 1.05, len(springs)),
        mass=0.02,
        velocities=generator.normal(0, 0.05, (6, 3)) * [1, 1, 0] + [0.5, 0.2, 0],
        ground_height=0.1,
        gravity=9.81,
        drag=0.4,
        strain_limit=0.03,
        compression_ratio=0.8,
        restitution=0.15,
        friction=0.3,
        ground_projection=0.3,
        contact_threshold=0.02,
        contact_radius=0.003,
        controller_stiffness=25.0,
        controller_radius=0.05,
        controller_neighbours=1,
        flat=False,
    )


def bars_that_collide() -> RolloutBatch:
    """A bar flies obliquely against another, far from it at rest; one node hits two at once."""
    positions = np.array([[0, 0, 0.016], [0.1, 0.01, 0.019], [-0.013, 0.005, 0], [0.013, -0.004, 0.002], [0.1, 0, 0]])
    springs = np.array([(0, 1), (2, 3), (3, 4)])
    times = np.array([0.0, 0.02, 0.035])
    batch = scene(
        positions,
        Controls(times=times, positions=np.zeros((3, 0, 3)), contact=np.zeros((3, 0), np.uint8)),
        springs=springs,
        stiffness=8.0,
        damping=0.02,
        rest_lengths=lengths(positions, springs) * 0.95,
        mass=0.02,
        velocities=[[0.2, 0.1, -0.3], [0.15, 0.1, -0.35], [0, 0, 0.1], [0.05, 0, 0.1], [0, 0, 0.1]],
        collision_distance=0.02,
        collision_restitution=0.3,
        collision_friction=0.25,
        gravity=9.81,
        flat=False,
    )
    return replace(batch, rest_positions=np.float32(100.0) * positions.astype(np.float32))
