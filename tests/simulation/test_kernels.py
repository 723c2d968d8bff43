"""The Warp kernels against the float64 reference, and the kernels of the GPU against those of the CPU."""

import numpy as np
import pytest
import warp as wp

from egophys_core.simulation import batch_of_models, rollout, step
from egophys_core.simulation import rollout as rollout_function
from egophys_core.twin import ObjectKind
from tests.reference.simulator import simulate
from tests.simulation.scenes import frame_times, moving_controls, scene, sheet_positions
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
    hold = np.repeat((np.arange(len(times)) >= 5)[:, None], 2, axis=1)
    hold[14:, 1] = False
    return scene(
        positions,
        moving_controls(times, path, hold),
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


def gpu_launches(substeps, state, springs, controllers, parameters, device):
    """What a frame is on a GPU, two launches a substep, here on the CPU device."""
    groups = state.positions.shape[0]
    for substep in range(substeps):
        wp.launch(
            step.gather_forces,
            dim=(groups, state.node_count),
            inputs=[state, springs, parameters],
            device=device,
        )
        wp.launch(
            step.advance_substep,
            dim=(groups, state.node_count + state.controller_count),
            inputs=[substep, state, controllers, parameters],
            device=device,
        )


def test_gpu_kernels_do_what_the_cpu_kernel_does(monkeypatch):
    models, controls = mixed_batch(ObjectKind.SHEET)
    batch = batch_of_models(models, controls, ground_height=0.0)
    by_frame = rollout(batch)
    monkeypatch.setitem(rollout_function.__globals__, "_launch_frame", gpu_launches)
    by_substep = rollout(batch)
    assert np.array_equal(by_frame.positions, by_substep.positions)
    assert np.array_equal(by_frame.velocities, by_substep.velocities)


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")
def test_cuda_agrees_with_the_float64_reference():
    batch = everything_at_once(0, flat=True)
    result = rollout(batch, device="cuda:0")
    assert np.abs(result.positions[0] - simulate(batch, 0, substeps=SUBSTEPS)).max() < 5e-5
