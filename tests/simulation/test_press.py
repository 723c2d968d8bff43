"""Contacts that press: they push whatever comes near, brake what slides along them, and never pull."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.simulation import ContactKind, Controls, RolloutBatch, rollout
from tests.reference.simulator import simulate
from tests.simulation.scenes import frame_times, moving_controls, scene, sheet_positions

NONE, HOLD, PRESS = ContactKind.NONE, ContactKind.HOLD, ContactKind.PRESS
DT = 1 / 600
"""Frames of one substep, so that velocities are differences of positions."""
ROUNDING = 1e-5
"""m/s: of float32 positions of some centimetres, over DT."""


def hand(times: np.ndarray, *stops: tuple[float, float]) -> np.ndarray:
    """[F, 3] metres along x, from stop to stop (time, x), the node being at the origin."""
    at, x = zip(*stops, strict=True)
    return np.interp(times, at, x)[:, None] * [1.0, 0, 0]


BODY = {"mass": 0.05, "damping": 0.05, "controller_stiffness": 3.0, "controller_radius": 0.03}


def node_and_hand(path: np.ndarray, kinds: np.ndarray, times: np.ndarray, **changes) -> RolloutBatch:
    """A free node of 50 g at the origin."""
    return scene([[0, 0, 0]], moving_controls(times, path, kinds), **{**BODY, **changes})


def all_the_time(kind: ContactKind, times: np.ndarray) -> np.ndarray:
    return np.full((len(times), 1), kind, np.uint8)


def speeds(batch: RolloutBatch) -> np.ndarray:
    """[F - 1] m/s along x in each substep."""
    result = rollout(batch)
    assert result.substeps.tolist() == [1]
    return np.diff(result.positions[0, :, 0, 0].astype(np.float64)) / DT


def test_press_pushes_the_node_ahead_of_the_hand():
    # From 2 cm off the hand goes 4 cm in 0.2 s and stops: what it pushed flies on at its speed or faster.
    times = frame_times(0.5, DT)
    path = hand(times, (0.0, 0.02), (0.2, -0.02))
    speed = speeds(node_and_hand(path, all_the_time(PRESS, times), times))
    assert speed[-1] < -0.2
    assert (np.diff(speed) <= ROUNDING).all()


@pytest.mark.parametrize("damping", [0.0, 0.5, 5.0])
@pytest.mark.parametrize("retreat", [0.05, 0.5, 5.0])
def test_press_never_pulls_however_fast_the_hand_retreats(damping, retreat):
    # The hand comes against the node and goes back while the contact is compressed: its spring still pushes, its
    # dashpot would pull. The node may only ever be sped up away from the hand.
    times = frame_times(0.3, DT)
    path = hand(times, (0.0, 0.02), (0.05, 0.0), (0.07, 0.0), (0.17, 0.1 * retreat))
    batch = node_and_hand(path, all_the_time(PRESS, times), times, damping=damping)
    change = np.diff(speeds(batch))
    assert change.min() < -1e-3
    assert change.max() <= ROUNDING


def test_hold_pulls_the_node_along_where_a_press_lets_it_lie():
    times = frame_times(0.3, DT)
    path = hand(times, (0.0, 0.02), (0.2, 0.12))
    moved = [
        rollout(node_and_hand(path, all_the_time(kind, times), times)).positions[0, -1, 0, 0] for kind in (HOLD, PRESS)
    ]
    assert moved[0] > 0.05
    assert moved[1] == 0.0


def test_press_acts_on_what_comes_near_later():
    # The hand begins to press 2 cm off one node, and comes as near to another from there on.
    times = frame_times(0.5, DT)
    path = hand(times, (0.0, 0.02), (0.2, 0.1), (0.45, 0.205))
    batch = scene([[0, 0, 0], [0.2, 0, 0]], moving_controls(times, path, all_the_time(PRESS, times)), **BODY)
    x = rollout(batch).positions[0, :, :, 0]
    assert (x[:, 0] == 0.0).all()
    reached = np.argmax(path[:, 0] > 0.2 - 0.02)
    assert (x[: reached - 2, 1] == x[0, 1]).all()
    assert x[-1, 1] > 0.22


@pytest.mark.parametrize("friction", [0.0, 0.3, 3.0])
def test_hand_that_slides_along_a_surface_drags_it_by_coulombs_law(friction):
    # It presses a heavy node with a force N, 1 m off so that it pushes straight all the time, and slides across it by
    # 1 cm: the node is sped up by mu N / m.
    times = frame_times(0.2, DT)
    across = np.stack([0 * times + 0.999, 0.1 * np.maximum(times - 0.1, 0.0), 0 * times], axis=1)
    across[times < DT / 2, 0] = 1.0
    batch = scene(
        [[0, 0, 0]],
        moving_controls(times, across, all_the_time(PRESS, times)),
        **{**BODY, "mass": 50.0, "collision_friction": friction, "damping": 0.0},
    )
    moved = rollout(batch).positions[0, :, 0].astype(np.float64)
    push = 10.0 * BODY["controller_stiffness"] * 0.001
    way = 0.5 * push / 50.0 * (times[-1] - 0.1) ** 2
    assert moved[-1, 1] == pytest.approx(friction * way, rel=0.05, abs=0.01 * way)


def test_force_of_a_press_comes_from_motion_since_it_began():
    # It begins with the hand at rest 1 cm off the node, after coming from afar: nothing moves until the hand does.
    times = frame_times(0.4, DT)
    path = hand(times, (0.0, 0.05), (0.1, 0.01), (0.25, 0.01), (0.3, 0.0))
    kinds = np.where(times[:, None] >= 0.15, PRESS, NONE).astype(np.uint8)
    x = rollout(node_and_hand(path, kinds, times)).positions[0, :, 0, 0]
    # Central differences let the hand move in the frame before it does.
    assert (x[times < 0.25 - 2 * DT] == 0).all()
    assert x[-1] < -1e-3


def test_press_that_ends_lets_go():
    times = frame_times(0.3, DT)
    path = hand(times, (0.0, 0.02), (0.3, -0.1))
    kinds = np.where(times[:, None] < 0.1, PRESS, NONE).astype(np.uint8)
    speed = speeds(node_and_hand(path, kinds, times))
    assert speed[60] < -0.1
    assert np.abs(speed[60:] - speed[60]).max() < ROUNDING


def test_press_that_becomes_a_hold_holds_at_the_distance_of_that_moment():
    # The press has pushed the node off 3 mm or so when the hand, at rest, takes hold of it: from then on it is held
    # where it is and comes along, and the press that was there does not act any more.
    times = frame_times(1.0, DT)
    path = hand(times, (0.0, 0.02), (0.1, 0.012), (0.5, 0.012), (0.8, 0.042))
    kinds = np.where(times[:, None] < 0.4, PRESS, HOLD).astype(np.uint8)
    firm = {"controller_stiffness": 30.0, "damping": 0.3}
    x = rollout(node_and_hand(path, kinds, times, drag=20.0, **firm)).positions[0, :, 0, 0]
    begin = round(0.4 / DT)
    assert x[begin] < -0.003
    assert x[begin : round(0.5 / DT) - 2] == pytest.approx(x[begin], abs=1e-4)
    assert x[-1] - x[begin] == pytest.approx(0.03, abs=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_presses_and_holds_by_turns_agree_with_the_float64_reference(seed):
    # Two hands at a net on the table: each presses, lets go, holds and presses, at other times.
    generator = np.random.default_rng(seed)
    positions = sheet_positions(3, spacing=0.06, height=0.003).astype(np.float64)
    springs = np.array([(i, j) for i in range(9) for j in range(i + 1, 9) if generator.random() < 0.4])
    times = frame_times(0.5, 1 / 30)
    oscillation = 0.03 * np.sin(generator.uniform(8, 14, (1, 2, 3)) * times[:, None, None])
    path = positions[[0, 8]] + generator.normal(0, 0.01, (2, 3)) + [0, 0, 0.02] + oscillation
    kinds = np.stack([np.repeat([PRESS, NONE, HOLD, PRESS], 4), np.repeat([NONE, PRESS, HOLD, HOLD], 4)], axis=1)
    batch = scene(
        positions,
        Controls(times=times, positions=path.astype(np.float32), contact=kinds.astype(np.uint8)),
        springs=springs,
        stiffness=8.0,
        damping=0.03,
        rest_lengths=np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1),
        mass=0.01,
        ground_height=0.0,
        gravity=9.81,
        friction=0.4,
        controller_stiffness=12.0,
        controller_radius=0.07,
        controller_neighbours=4,
    )
    # Whether a press that begins acts in its first substep already is decided by rounding. The elastic force is 0
    # then, and a dashpot of 0.002 N s/m on 10 g takes 3e-4 of the speed in 1/600 s.
    batch = replace(batch, parameters=(replace(batch.parameters[0], damping=0.002),))
    result = rollout(batch)
    exact = simulate(batch, 0, substeps=20)
    assert np.linalg.norm(exact[-1] - exact[0], axis=1).max() > 0.005
    assert np.abs(result.positions[0] - exact).max() < 5e-5
