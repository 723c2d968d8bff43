"""Many rollouts at once: what they share must not show."""

import dataclasses
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp

from egophys_core.errors import SimulationError
from egophys_core.simulation import ContactKind, Controls, batch_of_models, rollout
from tests.simulation.scenes import frame_times, idle_controls, moving_controls, scene, sheet_model, sheet_positions

COUNT = 13
"""Two lane groups, the second only partly filled."""


def hand_over_sheet(times: np.ndarray, index: int) -> Controls:
    """Two points near two corners of the sheet that lift it and carry it off, each rollout elsewhere.

    In every third rollout one of them only presses, or does so before it takes hold.
    """
    generator = np.random.default_rng(index)
    goal = generator.uniform(-0.1, 0.1, (1, 3)) + [0, 0, 0.12]
    start = np.array([[-0.07, -0.07, 0.01], [0.07, 0.07, 0.01]])
    path = start + np.clip((times - 0.15) / 0.5, 0, 1)[:, None, None] * goal
    contact = np.full((len(times), 2), ContactKind.HOLD, np.uint8)
    contact[: 1 + index % 4] = ContactKind.NONE
    if index % 3 == 0:
        contact[len(times) - 8 :, index % 2] = ContactKind.NONE
    if index % 3 == 1:
        contact[4 : 12 + index, index % 2] = ContactKind.PRESS
    return Controls(times=times, positions=path.astype(np.float32), contact=contact)


def mixed_batch(kind: str = "sheet", *, collision_distance: float = 0.0):
    """Models and controls of thirteen rollouts that differ in springs, parameters and controls."""
    times = frame_times(1.2, 1 / 30)
    positions = sheet_positions(4, height=0.004)
    models = [
        sheet_model(
            positions,
            kind=kind,
            radius=0.055 + 0.01 * (index % 5),
            max_neighbours=4 + index % 6,
            stiffness=10.0 * 3.0 ** (index % 7),
            damping=0.004 * (1 + index % 4),
            friction=0.1 * index,
            restitution=0.05 * (index % 3),
            drag=0.1 * (index % 2),
            strain_limit=0.1 + 0.1 * (index % 5),
            compression_ratio=1.0 - 0.2 * (index % 4),
            ground_projection=0.1 * (index % 4),
            controller_stiffness=15.0 * (1 + index % 3),
            controller_neighbours=1 + index % 6,
            collision_distance=collision_distance,
            collision_friction=0.1 * (index % 3),
        )
        for index in range(COUNT)
    ]
    return models, [hand_over_sheet(times, index) for index in range(COUNT)]


@pytest.mark.parametrize(("kind", "collision_distance"), [("sheet", 0.0), ("sheet", 0.04), ("solid", 0.0)])
def test_rollout_is_the_same_to_the_bit_alone_and_in_a_batch(kind, collision_distance):
    models, controls = mixed_batch(kind, collision_distance=collision_distance)
    together = rollout(batch_of_models(models, controls, ground_height=0.0))
    together.raise_on_failure()
    assert np.abs(together.positions[:, -1] - together.positions[:, 0]).max(axis=(1, 2)).min() > 0.01
    assert len(np.unique(together.substeps)) > 1
    for index in range(COUNT):
        alone = rollout(batch_of_models([models[index]], [controls[index]], ground_height=0.0))
        assert np.array_equal(alone.positions[0], together.positions[index]), f"rollout {index}"
        assert np.array_equal(alone.velocities[0], together.velocities[index]), f"rollout {index}"
        assert alone.substeps[0] == together.substeps[index]


def test_nodes_of_the_mixed_batch_do_collide():
    plain, colliding = (
        rollout(batch_of_models(*mixed_batch(collision_distance=distance), ground_height=0.0)).positions
        for distance in (0.0, 0.04)
    )
    assert (np.abs(plain - colliding).max(axis=(1, 2, 3)) > 1e-4).sum() > COUNT / 2


def test_order_in_the_batch_does_not_matter():
    models, controls = mixed_batch()
    forward = rollout(batch_of_models(models, controls, ground_height=0.0))
    backward = rollout(batch_of_models(models[::-1], controls[::-1], ground_height=0.0))
    assert np.array_equal(forward.positions, backward.positions[::-1])
    assert np.array_equal(forward.velocities, backward.velocities[::-1])


def test_same_batch_gives_the_same_bits_again():
    models, controls = mixed_batch()
    first, second = (rollout(batch_of_models(models, controls, ground_height=0.0)) for _ in range(2))
    assert np.array_equal(first.positions, second.positions)


def test_turning_the_scene_about_the_vertical_turns_the_motion():
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])

    def run(rotation: np.ndarray) -> np.ndarray:
        positions = sheet_positions(4, height=0.004).astype(np.float64)
        springs = sheet_model().graph.springs
        # An arm's length off the axis, sliding on the table while a hand lifts a corner.
        start = positions + [0.2, 0.1, 0]
        times = frame_times(0.8, 1 / 30)
        path = start[0] + [0, 0, 0.02] + np.clip(times - 0.1, 0, 0.4)[:, None] * [0.1, -0.2, 0.3]
        batch = scene(
            start @ rotation.T,
            moving_controls(times, path @ rotation.T),
            springs=springs,
            stiffness=15.0,
            damping=0.02,
            rest_lengths=np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1),
            mass=0.006,
            velocities=np.tile([0.3, 0.1, 0], (16, 1)) @ rotation.T,
            ground_height=0.0,
            friction=0.5,
            restitution=0.2,
            gravity=9.81,
            drag=0.2,
            strain_limit=0.3,
            controller_stiffness=15.0,
        )
        return rollout(batch).positions[0]

    plain, turned = run(np.eye(3)), run(turn)
    assert np.abs(plain[-1] - plain[0]).max() > 0.05
    assert np.abs(turned - plain @ turn.T).max() < 2e-5


def test_models_of_different_objects_are_refused():
    controls = [idle_controls(frame_times(0.1, 1 / 30))] * 2
    with pytest.raises(SimulationError, match="same kind and number of nodes"):
        batch_of_models([sheet_model(), sheet_model(sheet_positions(3))], controls, ground_height=0.0)
    with pytest.raises(SimulationError, match="same kind and number of nodes"):
        batch_of_models([sheet_model(), sheet_model(kind="solid")], controls, ground_height=0.0)


def test_models_whose_springs_have_other_rest_lengths_are_kept_apart():
    models = [sheet_model(), sheet_model(1.5 * sheet_positions(), radius=0.12)]
    controls = [hand_over_sheet(frame_times(0.8, 1 / 30), 0)] * 2
    together = rollout(batch_of_models(models, controls, ground_height=-1.0))
    for index in range(2):
        alone = rollout(batch_of_models(models[index : index + 1], controls[:1], ground_height=-1.0))
        assert np.array_equal(together.positions[index], alone.positions[0])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"stiffness": np.ones((1, 2), np.float32)}, r"stiffness must be \(1, 1\), got \(1, 2\)"),
        ({"masses": np.ones((1, 3), np.float32)}, r"masses must be \(1, 2\), got \(1, 3\)"),
        ({"positions": np.zeros((1, 2), np.float32)}, "must be"),
        ({"positions": np.full((1, 2, 3), np.nan, np.float32)}, "must be finite"),
        ({"velocities": np.full((1, 2, 3), np.inf, np.float32)}, "must be finite"),
        ({"controls": ()}, "one control sequence per rollout: 1 and 0"),
    ],
)
def test_ill_formed_batches_are_refused(change, text):
    batch = scene([[0, 0, 0], [1, 0, 0]], idle_controls(np.array([0.0, 0.1])), springs=[(0, 1)], rest_lengths=[1.0])
    with pytest.raises(SimulationError, match=text):
        dataclasses.replace(batch, **change)


def test_rollouts_must_share_their_times():
    models = [sheet_model()] * 2
    controls = [idle_controls(frame_times(0.1, 1 / 30)), idle_controls(frame_times(0.2, 1 / 30))]
    with pytest.raises(SimulationError, match="controls of rollout 1 differ from rollout 0"):
        batch_of_models(models, controls, ground_height=0.0)


FIRST_IN_THREADS = """
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from egophys_core.simulation import batch_of_models, rollout
from tests.identification.synthetic import known_model, sheet_shape
from tests.simulation.scenes import frame_times, idle_controls

sheet = known_model(sheet_shape(6))
sheet = replace(sheet, parameters=replace(sheet.parameters, collision_distance=0.01))
batch = batch_of_models([sheet] * 16, [idle_controls(frame_times(0.3, 1 / 30))] * 16, ground_height=0.0)
with ThreadPoolExecutor(6) as pool:
    ends = list(pool.map(lambda _: rollout(batch).positions.sum(), range(12)))
assert len(set(ends)) == 1
"""


def test_the_first_rollouts_of_a_process_may_be_in_threads():
    """Where each loaded what it met, up to nine of ten processes ended with a segmentation fault."""
    ended = subprocess.run([sys.executable, "-c", FIRST_IN_THREADS], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr


def test_threads_load_kernels_one_after_the_other(monkeypatch):
    """The second of two that loaded one module would unload what the first already runs."""
    at_once, most, load = [], [], wp.load_module

    def watched(module, **rest):
        at_once.append(module)
        most.append(len(at_once))
        time.sleep(0.005)
        load(module, **rest)
        at_once.remove(module)

    monkeypatch.setattr(wp, "load_module", watched)
    batch = batch_of_models([sheet_model()], [idle_controls(frame_times(0.1, 1 / 30))], ground_height=0.0)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: rollout(batch), range(4)))
    assert len(most) >= 16
    assert max(most) == 1
