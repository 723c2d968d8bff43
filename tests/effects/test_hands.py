"""Hands that slip, and hands that were elsewhere than recorded."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.effects import LIBRARY, TwinEffect
from egophys_core.effects.rotations import rotation
from egophys_core.simulation import ContactKind, Controls, batch_of_models
from tests.effects.situations import FRAME, centre_path, lifted, run, sheet, with_effect
from tests.simulation.scenes import frame_times, sheet_model

HELD = np.ones((20, 3), bool)


def straight(frames=20):
    """Three controllers that move along (0.3, 0, 0.6) m/s."""
    start = np.array([[0, 0, 0.1], [0.02, 0, 0.1], [0.5, 0, 0.1]])
    return start + (np.arange(frames) * FRAME)[:, None, None] * np.array([0.3, 0.0, 0.6])


def test_a_slip_goes_along_the_pull_from_its_onset_on_and_to_its_side():
    frames = np.arange(20)
    pulls = np.zeros((20, 3, 3))
    pulls[:, 0], pulls[:, 1], pulls[:, 2] = [0, 0, -0.5], [2.0, 0, 0], [0, 0, -0.01]
    values = {"x": 0.05, "y": 0.0, "z": -0.1, "onset": 7.5 * FRAME}
    slid = LIBRARY["grasp_slip"].slide(values, frames * FRAME, (frames + 1) * FRAME, pulls).cumsum(axis=0)
    since = np.maximum(frames[:, None] + 1 - 7.5, 0.0) * FRAME
    assert slid[:, 0] == pytest.approx(since * [0.05, 0.0, -0.1])
    assert slid[:, 1] == pytest.approx(since * [0.15, 0.0, 0.0])
    assert (slid[:, 2] == 0.0).all()


def test_a_slipping_object_sinks_under_the_hand():
    model = sheet(controller_stiffness=200.0, drag=2.0, stiffness=100.0)
    still = lifted(duration=1.5, height=0.0)
    plain = run(model, still).positions[0, :, :, 2].mean(axis=1)
    slips = (
        run(with_effect(model, "grasp_slip", x=0.0, y=0.0, z=-0.05, onset=0.5), still)
        .positions[0, :, :, 2]
        .mean(axis=1)
    )
    before = still.times < 0.49
    assert np.abs(slips - plain)[before].max() < 1e-6
    assert slips[-1] - plain[-1] == pytest.approx(-0.05, abs=0.01)


def test_an_object_recorded_at_a_scale_meets_hands_and_falls_at_that_scale():
    effect, path = LIBRARY["tracking_scale"], straight()
    assert effect.drive({"scale": 0.9}, np.arange(20) * FRAME, path, HELD) == pytest.approx(0.9 * path)
    model = sheet(gravity=9.81)
    fallen = [
        centre_path(run(each, duration=0.3))[[0, -1], 2]
        for each in (model, with_effect(model, "tracking_scale", scale=0.9))
    ]
    assert np.ptp(fallen[1]) == pytest.approx(0.9 * np.ptp(fallen[0]), rel=1e-3)


@pytest.mark.parametrize(("values", "axis"), [((0.2, 0.0), (1, 0, 0)), ((0.0, 0.2), (0, 1, 0))])
def test_a_tilted_tracking_frame_records_the_vertical_tilted(values, axis):
    frame = LIBRARY["tracking_rotation"].frame({"about_x": values[0], "about_y": values[1]})
    assert frame @ axis == pytest.approx(np.array(axis))
    assert frame @ [0, 0, 1] == pytest.approx(
        np.cos(0.2) * np.array([0, 0, 1]) + np.sin(0.2) * np.cross(axis, [0, 0, 1])
    )
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_a_scaled_hand_lifts_by_a_scaled_displacement():
    model = with_effect(sheet(gravity=0.0, controller_stiffness=500.0), "tracking_scale", scale=1.5)
    controls = lifted(duration=2.0, height=0.1)
    result = run(model, controls)
    corner = np.linalg.norm(result.positions[0, 0] - [0.07, 0.07, 0], axis=1).argmin()
    assert np.ptp(result.positions[0, [0, -1], corner, 2]) == pytest.approx(0.15, abs=0.006)


@pytest.mark.parametrize("vector", [(0.3, -0.2, 0.9), (0.0, 0.0, 1e-8), (0.0, 0.0, 0.0)])
def test_rotations_keep_lengths_and_their_axis(vector):
    matrix = rotation(np.array(vector))
    assert matrix @ matrix.T == pytest.approx(np.eye(3))
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    assert matrix @ vector == pytest.approx(np.array(vector))


def test_a_delayed_hand_is_where_it_was():
    controls = lifted(duration=1.0, height=0.3)
    contact = np.where(controls.times[:, None] < 0.5, ContactKind.NONE, ContactKind.HOLD)
    controls = replace(controls, contact=np.broadcast_to(contact, controls.contact.shape).astype(np.uint8))
    delayed = TwinEffect(name="control_delay", values={"delay": 3 * FRAME})
    model = replace(sheet_model(), effects=(delayed,))
    moved = batch_of_models([model], [controls], ground_height=0.0).controls[0]
    late = np.maximum(controls.times - 3 * FRAME, 0.0)
    assert moved.positions[:, 0, 2] == pytest.approx(0.3 * late, abs=1e-5)
    assert np.array_equal(moved.contact[3:], controls.contact[:-3])


def test_an_offset_of_tracking_moves_every_hand_alike():
    path = straight()
    moved = LIBRARY["tracking_offset"].drive({"x": 0.01, "y": -0.02, "z": 0.0}, np.arange(20) * FRAME, path, HELD)
    assert moved - path == pytest.approx(np.broadcast_to([0.01, -0.02, 0.0], path.shape))


def turning_hands():
    """Two hands of four points; the first turns by 90 degrees about z, the second keeps still."""
    times = frame_times(1.0, FRAME)
    shape = np.array([[0.02, 0, 0], [-0.02, 0, 0], [0, 0.03, 0], [0, 0, 0.02]])
    turned = [shape @ rotation(np.array([0, 0, time * np.pi / 2])).T + [0.1 * time, 0, 0.2] for time in times]
    path = np.concatenate([np.array(turned), np.tile(shape + [0.5, 0, 0.2], (len(times), 1, 1))], axis=1)
    return Controls(times=times, positions=path.astype(np.float32), contact=np.ones(path.shape[:2], np.uint8))


def test_an_offset_of_the_gripper_turns_with_its_own_hand():
    controls = turning_hands()
    path = controls.positions.astype(float)
    away = (
        LIBRARY["gripper_offset"].drive({"x": 0.01, "y": 0.0, "z": 0.002}, controls.times, path, controls.contact)
        - path
    )
    assert away[0] == pytest.approx(np.tile([0.01, 0, 0.002], (8, 1)), abs=1e-6)
    assert away[-1, :4] == pytest.approx(np.tile([0, 0.01, 0.002], (4, 1)), abs=1e-6)
    assert away[-1, 4:] == pytest.approx(np.tile([0.01, 0, 0.002], (4, 1)), abs=1e-6)


@pytest.mark.parametrize("points", [1, 2, 3])
def test_points_on_a_line_do_not_tell_how_the_gripper_turns(points):
    path = turning_hands().positions[:, :1].astype(float) + 0.01 * np.arange(points)[:, None] * [1.0, 0, 0]
    away = (
        LIBRARY["gripper_offset"].drive({"x": 0.01, "y": 0.0, "z": 0.0}, np.arange(len(path)) * FRAME, path, HELD)
        - path
    )
    assert away == pytest.approx(np.broadcast_to([0.01, 0, 0], path.shape))
