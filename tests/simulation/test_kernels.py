"""The Warp kernels against the float64 reference, and the kernels of the GPU against those of the CPU."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from egophys_core.simulation import ContactKind, batch_of_models, rollout
from tests.reference.simulator import simulate
from tests.simulation.scenes import frame_times, moving_controls, scene, sheet_positions
from tests.simulation.substep_path import advance_by_launches
from tests.simulation.test_batches import mixed_batch

SUBSTEPS = 20
"""Of a frame of 1/30 s when the scene is soft enough for steps of 1/600 s."""


def everything_at_once(seed: int, *, flat: bool):
    """A small net that is thrown on the table, caught by two points and let go by one."""
    generator = np.random.default_rng(seed)
    positions = sheet_positions(3, spacing=0.06, height=0.02).astype(np.float64)
    positions += generator.normal(0, 0.005, positions.shape)
    pairs = np.array([(i, j) for i in range(9) for j in range(i + 1, 9) if generator.random() < 0.45])
    lengths = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    times = frame_times(0.7, 1 / 30)
    path = (
        positions[[0, 8]]
        + [0, 0, 0.015]
        + np.clip(times - 0.25, 0, 0.3)[:, None, None] * generator.normal(0.2, 0.1, (2, 3))
    )
    contact = np.repeat(np.where(np.arange(len(times)) >= 5, ContactKind.HOLD, ContactKind.NONE)[:, None], 2, axis=1)
    contact[14:, 1] = ContactKind.NONE
    return scene(
        positions,
        moving_controls(times, path, contact),
        springs=pairs,
        stiffness=8.0,
        damping=0.02,
        rest_lengths=lengths * generator.uniform(0.7, 1.1, len(pairs)),
        mass=0.01,
        velocities=generator.normal(0, 0.15, positions.shape),
        ground_height=0.0,
        flat=flat,
        gravity=9.81,
        drag=0.3,
        strain_limit=0.2,
        compression_ratio=0.4,
        restitution=0.3,
        friction=0.4,
        ground_projection=0.3,
        contact_threshold=0.004,
        contact_radius=0.003,
        controller_stiffness=12.0,
        controller_radius=0.07,
        controller_neighbours=6,
    )


@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_rollout_agrees_with_the_float64_reference(seed, flat):
    # Float32 carries 6e-8 of lengths near 0.1 m; over 420 steps and some bounces that grows to microns.
    batch = everything_at_once(seed, flat=flat)
    result = rollout(batch)
    assert result.substeps.tolist() == [SUBSTEPS]
    exact = simulate(batch, 0, substeps=SUBSTEPS)
    assert np.linalg.norm(exact[-1] - exact[0], axis=1).max() > 0.02
    assert np.abs(result.positions[0] - exact).max() < 5e-5


@pytest.mark.parametrize("collision_distance", [0.0, 0.04])
def test_gpu_kernels_do_what_the_cpu_kernel_does(collision_distance):
    batch = batch_of_models(*mixed_batch(collision_distance=collision_distance), ground_height=0.0)
    assert np.array_equal(rollout(batch).positions, advance_by_launches(batch)[0])


def test_gpu_kernels_find_the_same_divergence():
    batch = everything_at_once(0, flat=True).rows([0, 0, 0])
    fast = batch.velocities.copy()
    fast[1, 4] = [0, 0, 2000.0]
    batch = replace(batch, velocities=fast)
    positions, failures = advance_by_launches(batch)
    result = rollout(batch)
    assert failures == result.failures
    assert failures[0] is None
    assert "node 4 is faster than 1000 m/s or not finite on the way to frame 1 (t=0.002 s)" in str(failures[1])
    assert np.array_equal(positions[[0, 2]], result.positions[[0, 2]])


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")
def test_cuda_agrees_with_the_float64_reference():
    batch = everything_at_once(0, flat=True)
    result = rollout(batch, device="cuda:0")
    assert np.abs(result.positions[0] - simulate(batch, 0, substeps=SUBSTEPS)).max() < 5e-5
