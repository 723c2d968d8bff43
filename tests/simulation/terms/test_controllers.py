"""Controller points: they hold, pull with their velocity, and let go."""

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.simulation import Controls, rollout
from tests.simulation.scenes import FAR_BELOW, frame_times, moving_controls, scene

FPS = 1 / 30


def straight(times: np.ndarray, start, velocity) -> np.ndarray:
    return np.asarray(start) + times[:, None] * np.asarray(velocity)


@pytest.mark.parametrize("damping", [0.0, 0.5, 5.0])
def test_hand_and_object_that_move_together_do_not_pull_on_each_other(damping):
    # The dashpot acts against the controller's velocity, not against the world.
    times = frame_times(1.0, FPS)
    velocity = np.array([0.3, -0.2, 0.1])
    batch = scene(
        [[0, 0, 0]],
        moving_controls(times, straight(times, [0, 0, 0.02], velocity)),
        mass=0.05,
        damping=damping,
        controller_stiffness=30.0,
        velocities=[velocity],
    )
    moved = rollout(batch).positions[0, :, 0]
    assert np.abs(moved - straight(times, [0, 0, 0], velocity)).max() < 1e-5


def test_held_node_ends_up_moving_as_its_controller_does():
    times = frame_times(2.0, FPS)
    velocity = np.array([0.2, 0.1, 0.0])
    # Still for half a second, then at constant velocity.
    path = np.array([0, 0, 0.02]) + np.maximum(times - 0.5, 0.0)[:, None] * velocity
    batch = scene([[0, 0, 0]], moving_controls(times, path), mass=0.05, damping=1.0, controller_stiffness=30.0)
    result = rollout(batch)
    assert result.velocities[0, 0] == pytest.approx(velocity, abs=1e-4)
    assert np.linalg.norm(result.positions[0, -1, 0] - path[-1]) == pytest.approx(0.02, abs=1e-4)


def test_shaken_node_swings_with_the_amplitude_of_a_driven_oscillator():
    # m x'' = -k (x - a sin(w t)) along the spring, no damping, at rest before: with w0^2 = k / m
    # x = a w0^2 / (w0^2 - w^2) (sin(w t) - (w / w0) sin(w0 t)).
    mass, stiffness, amplitude, driven, dt = 0.1, 40.0, 0.005, 8.0, 1 / 600
    natural = np.sqrt(stiffness / mass)
    times = frame_times(1.5, dt)
    path = np.stack([0.02 + amplitude * np.sin(driven * times), 0 * times, 0 * times], axis=1)
    batch = scene([[0, 0, 0]], moving_controls(times, path), mass=mass, controller_stiffness=stiffness)
    moved = rollout(batch).positions[0, :, 0, 0]
    share = natural**2 / (natural**2 - driven**2)
    exact = amplitude * share * (np.sin(driven * times) - driven / natural * np.sin(natural * times))
    assert np.abs(moved - exact).max() < amplitude * share * natural * dt


def test_between_frames_a_controller_moves_smoothly():
    # Frames of 1/30 s against frames of 1/600 s of the same motion, both with substeps of 1/600 s. The Hermite
    # curve through frames h apart is off by at most h^4 max|p''''| / 384 + the error of its end slopes.
    def motion(dt: float) -> np.ndarray:
        times = frame_times(1.0, dt)
        path = np.stack([0.02 + 0.05 * (1 - np.cos(3 * times)), 0 * times, 0 * times], axis=1)
        batch = scene([[0, 0, 0]], moving_controls(times, path), mass=0.05, damping=0.2, controller_stiffness=30.0)
        return rollout(batch).positions[0, -1, 0]

    assert motion(FPS) == pytest.approx(motion(1 / 600), abs=2e-4)


def hold_between(times: np.ndarray, begin: int, end: int) -> np.ndarray:
    frames = np.arange(len(times))
    return ((frames >= begin) & (frames < end))[:, None]


def test_force_comes_from_motion_since_the_hold_began_alone():
    # The hand comes from afar, takes hold 2.5 cm from the node at rest, and stays: nothing may move.
    times = frame_times(1.0, FPS)
    path = np.array([0, 0, 0.025]) + np.maximum(0.5 - times, 0.0)[:, None] * [1.0, 0, 0]
    batch = scene(
        [[0, 0, 0]],
        moving_controls(times, path, hold_between(times, 16, 100)),
        mass=0.05,
        controller_stiffness=30.0,
    )
    assert np.abs(rollout(batch).positions).max() < 1e-6


def test_point_that_does_not_hold_moves_nothing():
    times = frame_times(1.0, FPS)
    batch = scene(
        [[0, 0, 0]],
        moving_controls(times, straight(times, [0, 0, 0.001], [0.2, 0, 0]), hold_between(times, 0, 0)),
        mass=0.05,
        damping=1.0,
        controller_stiffness=30.0,
    )
    assert (rollout(batch).positions == 0).all()


def test_let_go_means_free_flight():
    times = frame_times(1.0, FPS)
    path = np.array([0, 0, 0.02]) + np.maximum(times - 0.1, 0)[:, None] * [0.5, 0, 0]
    batch = scene(
        [[0, 0, 0]],
        moving_controls(times, path, hold_between(times, 0, 15)),
        mass=0.05,
        damping=0.5,
        controller_stiffness=30.0,
    )
    x = rollout(batch).positions[0, :, 0]
    steps = np.diff(x[15:], axis=0)
    assert np.linalg.norm(steps[0]) > 0.01
    assert np.abs(steps - steps[0]).max() < 1e-6


def test_taking_hold_again_holds_where_the_object_is_then():
    times = frame_times(1.5, FPS)
    # Lifts by 5 cm, lets go without gravity, moves away and back by 2 cm less, takes hold again.
    hold = hold_between(times, 0, 12) | hold_between(times, 25, 100)
    height = np.interp(times, [0.1, 0.3, 0.5, 0.7], [0.02, 0.07, 0.07, 0.05])
    path = np.stack([0 * times, 0 * times, height], axis=1)
    batch = scene(
        [[0, 0, 0]],
        moving_controls(times, path, hold),
        mass=0.05,
        damping=2.0,
        controller_stiffness=100.0,
    )
    z = rollout(batch).positions[0, :, 0, 2]
    assert z[12] == pytest.approx(0.05, abs=0.005)
    assert z[25:] == pytest.approx(z[25], abs=0.002)


def test_first_hand_keeps_its_springs_when_a_second_takes_hold():
    times = frame_times(1.0, FPS)
    still = np.tile([[-0.01, 0, 0], [0.11, 0, 0]], (len(times), 1, 1))
    still[:, 0, 0] -= 0.05 * np.clip((times - 0.2) / 0.2, 0, 1)
    hold = np.concatenate([hold_between(times, 0, 100), hold_between(times, 20, 100)], axis=1)
    batch = scene(
        [[0, 0, 0], [0.1, 0, 0]],
        Controls(times=times, positions=still.astype(np.float32), contact=hold),
        mass=0.05,
        damping=1.0,
        controller_stiffness=30.0,
        controller_neighbours=1,
    )
    x = rollout(batch).positions[0, -1]
    assert x == pytest.approx(np.array([[-0.05, 0, 0], [0.1, 0, 0]]), abs=1e-3)


def test_controls_without_any_controller_point_leave_the_object_alone():
    times = frame_times(0.5, 1 / 600)
    none = Controls(
        times=times, positions=np.zeros((len(times), 0, 3), np.float32), contact=np.zeros((len(times), 0), bool)
    )
    batch = scene([[0, 0, 1.0]], none, gravity=9.81, ground_height=FAR_BELOW)
    assert rollout(batch).positions[0, -1, 0, 2] == pytest.approx(1.0 - 9.81 * 0.125, abs=0.01)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"times": np.array([0.0, 0.0])}, "increasing times"),
        ({"times": np.array([0.0])}, "at least 2 increasing times, got 1"),
        ({"positions": np.zeros((2, 3), np.float32)}, r"must be \[2, C, 3\] in metres, got \(2, 3\)"),
        ({"positions": np.zeros((3, 1, 3), np.float32)}, r"got \(3, 1, 3\)"),
        ({"contact": np.zeros((2, 2), bool)}, r"contact must be \(2, 1\), got \(2, 2\)"),
        ({"positions": np.array([[[0, 0, 0]], [[0, np.nan, 0]]])}, "controller 0 is not finite at frame 1"),
        ({"payload": np.array([0.1, np.nan])}, "payload must be finite, got nan kg"),
    ],
)
def test_ill_formed_controls_are_refused(change, text):
    good = {"times": np.array([0.0, 0.1]), "positions": np.zeros((2, 1, 3)), "contact": np.zeros((2, 1), bool)}
    Controls(**good)
    with pytest.raises(SimulationError, match=text):
        Controls(**{**good, **change})
