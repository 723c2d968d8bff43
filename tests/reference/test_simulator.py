"""The reference simulator against cases worked by hand; the Warp simulator is then held against it."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.simulation import ContactKind, Controls
from tests.reference.simulator import (
    contact,
    controller_motion,
    new_grips,
    press_force,
    projected,
    simulate,
    spring_force,
)
from tests.simulation.scenes import idle_controls, moving_controls, parameters, scene


def force(offset, relative_velocity=(0, 0, 0), *, damping=0.0, longest=0.5):
    return spring_force(
        np.array(offset, float),
        np.array(relative_velocity, float),
        stiffness=10.0,
        damping=damping,
        rest=1.0,
        longest=longest,
    ).tolist()


def test_spring_pulls_when_stretched_and_pushes_when_compressed():
    assert force((1.2, 0, 0)) == pytest.approx([2.0, 0, 0])
    assert force((0, -0.6, 0)) == pytest.approx([0, 4.0, 0])
    # 3-4-5 triangle of length 1.25 m: 2.5 N along it.
    assert force((0.75, 1.0, 0)) == pytest.approx([1.5, 2.0, 0])


def test_spring_softens_beyond_its_longest_extension_in_tension_only():
    # Extension 2 m of at most 0.5 m: 10 N/m * 0.5 m.
    assert force((3.0, 0, 0)) == pytest.approx([5.0, 0, 0])
    assert force((0.1, 0, 0)) == pytest.approx([-9.0, 0, 0])


def test_dashpot_acts_against_the_whole_relative_velocity():
    assert force((1.0, 0, 0), (0, 2.0, -1.0), damping=0.5) == pytest.approx([0, -1.0, 0.5])


def test_upward_force_is_projected_in_the_band_only():
    alpha = parameters(contact_threshold=0.01, ground_projection=0.25)
    upward = np.array([1.0, 2.0, 4.0])
    assert projected(upward, 0.005, alpha).tolist() == [1.0, 2.0, 3.0]
    assert projected(upward, 0.01, alpha).tolist() == [1.0, 2.0, 4.0]
    assert projected(upward, -0.001, alpha).tolist() == [1.0, 2.0, 4.0]
    assert projected(-upward, 0.005, alpha).tolist() == [-1.0, -2.0, -4.0]


def test_contact_reverses_what_is_kept_and_brakes_what_slides():
    alpha = parameters(restitution=0.5, friction=0.2)
    # Falls from 0.1 m at 2 m/s: touches after 0.05 s, bounces with 1 m/s for 0.05 s.
    # Friction takes 0.2 * 1.5 * 2 of 3 m/s.
    velocity, rise = contact(0.1, np.array([3.0, 0, -2.0]), 0.1, alpha)
    assert velocity == pytest.approx([2.4, 0, 1.0])
    assert rise == pytest.approx(-0.1 + 0.05)
    velocity, rise = contact(0.3, np.array([3.0, 0, -2.0]), 0.1, alpha)
    assert velocity == pytest.approx([3.0, 0, -2.0])
    assert rise == pytest.approx(-0.2)


def test_friction_never_turns_the_sliding_around():
    velocity, _ = contact(0.0, np.array([0.1, 0, -2.0]), 0.1, parameters(friction=1.0))
    assert velocity == pytest.approx([0, 0, 0])


def push(offset, relative_velocity=(0, 0, 0), stopping=1e9):
    return press_force(
        np.array(offset, float),
        np.array(relative_velocity, float),
        stiffness=1.0,
        damping=0.05,
        reach=1.0,
        friction=0.25,
        stopping=stopping,
    ).tolist()


def test_press_pushes_what_is_in_reach_and_never_pulls():
    # In reach by 0.4 m: 4 N away from the hand.
    assert push((-0.6, 0, 0)) == pytest.approx([-4.0, 0, 0])
    assert push((-1.2, 0, 0), (0, 2.0, 0)) == [0, 0, 0]
    # The hand retreats at 6 m/s, the dashpot takes 3 N of the 4 N; at 10 m/s it would win.
    assert push((-0.6, 0, 0), (-6.0, 0, 0)) == pytest.approx([-1.0, 0, 0])
    assert push((-0.6, 0, 0), (-10.0, 2.0, 0)) == [0, 0, 0]


def test_press_brakes_what_slides_along_it_by_a_quarter_of_its_push_or_to_a_stop():
    assert push((-0.6, 0, 0), (0, 2.0, 0)) == pytest.approx([-4.0, -1.0, 0])
    assert push((-0.6, 0, 0), (0, 2.0, 0), stopping=0.2) == pytest.approx([-4.0, -0.4, 0])


def test_holds_take_the_nearest_within_the_radius_and_a_press_the_nearest():
    nodes = np.array([[0.01, 0, 0], [0.02, 0, 0], [0.05, 0, 0], [0.3, 0, 0]])
    alpha = parameters(controller_radius=0.03, controller_neighbours=3)
    hold, press = np.array([ContactKind.HOLD]), np.array([ContactKind.PRESS])
    held = new_grips(nodes, np.zeros((1, 3)), hold, alpha, flat=False)
    assert held == [(0, 0, pytest.approx(0.01), hold[0]), (1, 0, pytest.approx(0.02), hold[0])]
    flat = new_grips(nodes, np.zeros((1, 3)), hold, alpha, flat=True)
    assert [node for node, *_ in flat] == [0, 1, 2]
    far = np.array([[0.0, 0, 0.5]])
    for lies_flat in (True, False):
        assert new_grips(nodes, far, press, alpha, flat=lies_flat) == [
            (0, 0, pytest.approx(np.hypot(0.5, 0.01)), press[0])
        ]
    assert new_grips(nodes, np.zeros((1, 3)), np.zeros(1, np.uint8), alpha, flat=True) == []


def test_controller_passes_its_frames_with_the_slope_of_its_neighbours():
    times = np.array([0.0, 0.1, 0.2, 0.3])
    path = np.array([0.0, 1.0, 3.0, 4.0])[:, None, None] * [1.0, 0, 0]
    controls = Controls(times=times, positions=path, contact=np.ones((4, 1), bool))
    position, velocity = controller_motion(controls, 1, 0.0)
    assert position[0, 0] == 1.0
    assert velocity[0, 0] == pytest.approx(15.0)
    position, velocity = controller_motion(controls, 1, 1.0)
    assert position[0, 0] == pytest.approx(3.0)
    assert velocity[0, 0] == pytest.approx(15.0)
    # Halfway: (p0 + p1) / 2 + h (m0 - m1) / 8, slope 1.5 (p1 - p0) / h - (m0 + m1) / 4.
    position, velocity = controller_motion(controls, 1, 0.5)
    assert position[0, 0] == pytest.approx(2.0)
    assert velocity[0, 0] == pytest.approx(1.5 * 20 - 7.5)


def test_controller_has_the_slope_of_a_parabola_where_frames_differ():
    # p = t^2 through frames 0.1 s and 0.3 s apart: slope 2 t at the frame between, chords at the ends.
    times = np.array([0.0, 0.1, 0.4])
    path = (times**2)[:, None, None] * [1.0, 0, 0]
    controls = Controls(times=times, positions=path, contact=np.ones((3, 1), np.uint8))
    slopes = [controller_motion(controls, frame, share)[1][0, 0] for frame, share in ((0, 0.0), (1, 0.0), (1, 1.0))]
    assert slopes == pytest.approx([0.1, 0.2, 0.5])


def test_two_substeps_of_a_falling_node_by_hand():
    # v: -1, -2 m/s; z: 1 - 0.1, 0.9 - 0.2.
    batch = scene([[0, 0, 1.0]], idle_controls(np.array([0.0, 0.2])), gravity=10.0)
    assert simulate(batch, 0, substeps=2)[1, 0] == pytest.approx([0, 0, 0.7])


def test_two_substeps_of_a_held_node_by_hand():
    # Held 0.1 m off by a point that then moves 0.2 m away in a frame of 0.2 s, at 1 m/s throughout.
    # Substep 1: no stretch, dashpot 2 N s/m * 1 m/s = 2 N on 0.5 kg: v = 0.4, x = 0.04. The hand is at 0.2.
    # Substep 2: stretch 0.06 * 50 = 3 N, dashpot 2 * 0.6 = 1.2 N: v = 0.4 + 0.1 * 4.2 / 0.5 = 1.24, x = 0.164.
    times = np.array([0.0, 0.2])
    batch = scene(
        [[0, 0, 0]],
        moving_controls(times, [[0.1, 0, 0], [0.3, 0, 0]]),
        mass=0.5,
        damping=2.0,
        controller_stiffness=50.0,
        controller_radius=0.15,
    )
    assert simulate(batch, 0, substeps=2)[1, 0] == pytest.approx([0.164, 0, 0])


def test_two_substeps_of_a_press_by_hand():
    # 0.2 m off; the hand comes 0.2 m nearer within a frame of 0.2 s, at 1 m/s throughout.
    # Substep 1: not compressed, so no dashpot either. The hand is at 0.1.
    # Substep 2: 0.1 m in reach, 5 N, dashpot 2 N: 7 N on 0.5 kg for 0.1 s: v = -1.4, x = -0.14.
    times = np.array([0.0, 0.2])
    batch = scene(
        [[0, 0, 0]],
        moving_controls(times, [[0.2, 0, 0], [0, 0, 0]], np.full((2, 1), ContactKind.PRESS)),
        mass=0.5,
        damping=0.2,
        controller_stiffness=5.0,
        controller_radius=0.25,
    )
    assert simulate(batch, 0, substeps=2)[1, 0] == pytest.approx([-0.14, 0, 0])


def test_extra_forces_and_self_collision_of_two_nodes_by_hand():
    # 2 m apart at rest, now 10 cm, coming together at 2 m/s; the extra force on 1 kg adds (0, 0, 1) m/s a second.
    # Substep of 0.1 s: colliding below 0.2 m they stop and part with 0.1 m/s, both then move on with v_z = 0.1.
    batch = scene(
        [[0, 0, 0], [0.1, 0, 0]],
        idle_controls(np.array([0.0, 0.1])),
        velocities=[[1, 0, 0], [-1, 0, 0]],
        collision_distance=0.2,
        collision_friction=0.0,
    )
    batch = replace(batch, rest_positions=np.array([[0, 0, 0], [2.0, 0, 0]]))
    moved = simulate(batch, 0, substeps=1, extra=lambda time, dt, x, v: np.full((2, 3), [0, 0, 1.0]))
    assert moved[1] == pytest.approx(np.array([[-0.005, 0, 0.01], [0.105, 0, 0.01]]))
    near = replace(batch, rest_positions=np.array([[0, 0, 0], [0.31, 0, 0]]))
    assert simulate(near, 0, substeps=1)[1] == pytest.approx(np.array([[0.1, 0, 0], [0, 0, 0]]), abs=1e-7)
