"""Episodes of the rehearsal world look like a lab's, and what is injected into the tracking is in them exactly."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.errors import EgophysError, OptionsError
from egophys_core.experiments.hand_path import PathWriter, plan_of_path
from egophys_core.interpolation import values_at
from egophys_core.rehearsal import (
    Motion,
    RehearsalObject,
    RehearsalOptions,
    RehearsalWorld,
    rehearse,
    rehearse_plans,
)
from egophys_core.rehearsal.bodies import make_body
from egophys_core.rehearsal.hands import CONTACT_BEGINS, write_script

SHORT = RehearsalOptions(duration_s=0.4, points=40)
CLEAR = RehearsalOptions(duration_s=0.4, points=40, noise_m=0.0, dropout=0.0, occlusion=False)


@pytest.fixture(scope="module")
def clear():
    return rehearse(CLEAR, Motion.LIFT, seed=0)


@pytest.fixture(scope="module")
def lifted():
    return rehearse(RehearsalOptions(duration_s=2.0), Motion.LIFT, seed=0)


def test_same_seeds_same_episode():
    first, again = (rehearse(SHORT, Motion.LIFT, seed=5) for _ in range(2))
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first.controllers, again.controllers)
    other = rehearse(SHORT, Motion.LIFT, seed=6)
    assert not np.array_equal(first.points, other.points, equal_nan=True)


def test_a_size_of_nothing_changes_nothing(clear):
    nothing = rehearse(CLEAR, Motion.LIFT, seed=0, effects={"quadratic_drag": {"coefficient": 0.0}})
    np.testing.assert_array_equal(clear.points, nothing.points)


def test_an_episode_is_as_a_lab_records_it(lifted):
    assert lifted.points.shape == (60, 350, 3)
    assert lifted.controllers.shape == (60, 30, 3)
    np.testing.assert_allclose(np.diff(lifted.times), 1 / 30)
    assert set(np.unique(lifted.confidence)) == {np.float32(0.0), np.float32(0.9)}
    # Hands are far at first and touch from one second on; the object lies still until then.
    rest = np.nanmedian(lifted.points[:28], axis=0)
    gaps = [np.linalg.norm(rest[:, None] - lifted.controllers[frame], axis=2).min() for frame in (0, 31)]
    assert gaps[0] > 0.2
    assert gaps[1] < 0.01
    assert np.nanstd(lifted.points[:28] - rest) == pytest.approx(0.0015, rel=0.1)
    assert np.nanmax(lifted.points[-1, :, 2]) > 0.08
    assert 0.9 < lifted.visible[:20].mean() < 0.99


def test_what_is_behind_the_object_is_not_seen():
    episode = rehearse(
        RehearsalOptions(object=RehearsalObject.ELLIPSOID, duration_s=0.1, dropout=0.0), Motion.LIFT, seed=0
    )
    camera_side = np.nanmean(episode.points[0], axis=0)
    assert len(episode.point_ids) < 300
    assert camera_side[0] < 0.0 < camera_side[1]


@pytest.mark.parametrize("kind", RehearsalObject)
@pytest.mark.parametrize("motion", Motion)
def test_hands_of_every_motion_arrive_in_time_and_stay_in_reach_of_an_arm(kind, motion):
    body = make_body(RehearsalOptions(object=kind, points=3), 0)
    script = write_script(motion, body, body.vertices, np.random.default_rng(0))
    path = np.stack([script.at(time).centres for time in np.arange(0.0, 8.0, 1 / 30)])
    assert script.centres.shape[1] == (2 if "double" in motion or (motion, kind) == ("fold", "sheet") else 1)
    speed = 30.0 * np.linalg.norm(np.diff(path, axis=0), axis=2)
    assert speed[round(30 * CONTACT_BEGINS) - 1] == pytest.approx(0.0)
    assert speed.max() < 1.2
    assert speed[40:].max() > 0.05
    assert path[..., 2].min() > 0.0
    assert np.abs(path).max() < 0.6


def test_grips_reach_the_object_in_every_motion_that_holds():
    for kind in RehearsalObject:
        body = make_body(RehearsalOptions(object=kind, points=3), 0)
        for motion in Motion:
            script = write_script(motion, body, body.vertices, np.random.default_rng(0))
            gaps = np.linalg.norm(script.at(CONTACT_BEGINS).centres[:, None] - body.vertices, axis=2).min(axis=1)
            assert (gaps < 0.025).all() if np.isfinite(script.closes) else (gaps > 0.025).all()


@pytest.mark.parametrize(
    ("effect", "mapping"),
    [
        ({"tracking_scale": {"scale": 0.9}}, lambda p: 0.9 * p),
        ({"tracking_offset": {"x": 0.01, "y": 0.02, "z": -0.01}}, lambda p: p + [0.01, 0.02, -0.01]),
    ],
)
def test_tracking_errors_map_the_object_and_not_the_hands(clear, effect, mapping):
    injected = rehearse(CLEAR, Motion.LIFT, seed=0, effects=effect)
    np.testing.assert_allclose(injected.points, mapping(clear.points), atol=1e-6)
    np.testing.assert_array_equal(injected.controllers, clear.controllers)


def test_a_turned_tracking_frame_turns_object_and_hands(clear):
    effects = {"tracking_rotation": {"about_x": 0.2, "about_y": 0.0}}
    injected = rehearse(CLEAR, Motion.LIFT, seed=0, effects=effects)
    turn = Rotation.from_euler("x", 0.2).as_matrix().T
    np.testing.assert_allclose(injected.points, clear.points @ turn, atol=1e-6)
    np.testing.assert_allclose(injected.controllers, clear.controllers @ turn, atol=1e-6)


def test_late_hands_move_the_object_later():
    """With 3 frames of delay the object does what it did 3 frames before; its hands are recorded as ever."""
    options = RehearsalOptions(duration_s=1.6, points=40, noise_m=0.0, dropout=0.0, occlusion=False)
    plain = rehearse(options, Motion.LIFT, seed=0)
    late = rehearse(options, Motion.LIFT, seed=0, effects={"control_delay": {"delay": 0.1}})
    np.testing.assert_array_equal(late.controllers, plain.controllers)
    assert np.linalg.norm(late.points[-1] - plain.points[-1], axis=1).max() > 0.005
    np.testing.assert_allclose(late.points[40:], plain.points[37:-3], atol=5e-4)


def test_an_unknown_effect_suggests_the_nearest():
    with pytest.raises(OptionsError, match="did you mean 'uneven_mass'"):
        rehearse(SHORT, Motion.LIFT, seed=0, effects={"uneven_mas": {}})


def test_without_mujoco_it_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(EgophysError, match=r"pip install egophys\[rehearsal\]"):
        rehearse(SHORT, Motion.LIFT, seed=0)


def test_importing_the_room_needs_no_mujoco():
    program = "import sys, egophys_core.rehearsal, egophys_core.cli.rehearse; print('mujoco' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "False\n"


def test_progress_runs_to_one():
    shares: list[float] = []
    rehearse(SHORT, Motion.LIFT, seed=0, report=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_tool_lifts_the_object_step_by_step():
    world = RehearsalWorld(CLEAR, seed=0, effects={})
    before = world.points
    corner = before[np.argmax(before[:, 0] + before[:, 1])]
    tool = corner + np.array([[0.0, 0.01, 0.0], [0.0, -0.01, 0.0]])
    for step in range(20):
        seen = world.step(tool + [0.0, 0.0, 0.005 * step], 1 / 30, closed=True)
    assert world.time == pytest.approx(20 / 30)
    np.testing.assert_allclose(seen, world.points, atol=1e-6)
    assert seen[:, 2].max() > 0.07
    world.step(tool + [0.0, 0.0, 0.095], 0.4, closed=False)
    assert world.points[:, 2].max() < 0.05


def test_a_tool_that_turns_turns_the_object_and_its_points_as_a_plan_does():
    corner = RehearsalWorld(CLEAR, seed=0, effects={}).points.max(axis=0) - [0.012, 0.012, 0.0]
    writer = PathWriter(corner)
    writer.move([0.0, 0.0, 0.15], peak_speed=0.4)
    writer.turn(1.5, peak_rate=3.0)
    writer.wait(0.3)
    path = writer.path()
    episode = rehearse_plans(CLEAR, [plan_of_path(path, "")], name="turned", seed=0)
    cloud = 0.02 * np.vstack([np.eye(3), -np.eye(3)])
    world = RehearsalWorld(CLEAR, seed=0, effects={})
    for time in episode.times[1:]:
        at, turn = (values_at(path.times, record, time) for record in (path.positions, path.turns))
        closed = bool(path.holds[np.searchsorted(path.times, time, side="right") - 1])
        seen = world.step(at + Rotation.from_rotvec([0.0, 0.0, turn]).apply(cloud), 1 / 30, closed=closed)
    # The tool that goes frame by frame closes up to a frame later.
    assert np.linalg.norm(seen - episode.points[-1], axis=1).mean() < 3e-3
    first, last = (hands - hands.mean(axis=0) for hands in episode.controllers[[0, -1]])
    np.testing.assert_allclose(last, Rotation.from_rotvec([0.0, 0.0, 1.5]).apply(first), atol=1e-5)
    # Lifted it hung still; it is the turn that moves the sheet.
    lifted = episode.points[np.searchsorted(episode.times, path.times[np.flatnonzero(path.turns)[0] - 1])]
    assert np.linalg.norm(lifted - episode.points[-1], axis=1).mean() > 0.02


def test_a_tool_with_an_injected_delay_is_followed_late():
    heights = []
    for effects in ({}, {"control_delay": {"delay": 0.2}}):
        world = RehearsalWorld(CLEAR, seed=0, effects=effects)
        corner = world.points[np.argmax(world.points[:, 0] + world.points[:, 1])]
        for step in range(12):
            world.step(corner[None] + [0.0, 0.0, 0.005 * step], 1 / 30, closed=True)
        heights.append(world.points[:, 2].max())
    # 0.2 s at 0.15 m/s.
    assert heights[0] - heights[1] == pytest.approx(0.03, abs=0.005)


def test_a_tool_whose_points_change_is_refused():
    world = RehearsalWorld(CLEAR, seed=0, effects={})
    world.step(np.zeros((2, 3)), 0.1, closed=False)
    with pytest.raises(EgophysError, match="had 2 points before, and has 3 now"):
        world.step(np.zeros((3, 3)), 0.1, closed=False)


def test_a_tool_that_is_nowhere_is_refused():
    world = RehearsalWorld(CLEAR, seed=0, effects={})
    with pytest.raises(EgophysError, match=r"finite \[C, 3\] in metres"):
        world.step(np.full((2, 3), np.nan), 0.1, closed=False)
