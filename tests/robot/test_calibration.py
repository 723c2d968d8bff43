"""The calibration file and the fit that makes it."""

import json
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from egophys_core.cli.main import main
from egophys_core.errors import RobotError
from egophys_core.perception.camera.board import Board
from egophys_core.robot import Calibration, FitQuality, Transform, fit_world_to_base

WORLD_TO_BASE = Transform.from_rpy(np.array([0.45, -0.1, 0.02]), np.array([0.01, -0.02, 1.2]))
TOOL = Transform.from_rpy(np.array([0.0, 0.0, 0.172]), np.zeros(3))
SWAPPED = np.eye(3)[[1, 0, 2]]
ON_TABLE = np.array([[0.2, 0.1, 0], [-0.2, 0.1, 0], [0.2, -0.15, 0], [-0.2, -0.15, 0], [0, 0, 0], [0.1, -0.05, 0]])
POINTS = np.array([[0.2, 0.1, 0.0], [-0.2, 0.1, 0.0], [0.2, -0.15, 0.0], [0.0, 0.0, 0.2]])


def test_the_file_gives_the_calibration_back(tmp_path):
    path = tmp_path / "world_to_base.yaml"
    Calibration(world_to_base=WORLD_TO_BASE, tool=TOOL).save(path)
    loaded = Calibration.load(path)
    for saved, read in ((WORLD_TO_BASE, loaded.world_to_base), (TOOL, loaded.tool)):
        np.testing.assert_allclose(read.rotation, saved.rotation, atol=1e-12)
        np.testing.assert_allclose(read.translation, saved.translation, atol=1e-15)


def test_tcp_and_tool_are_inverse_of_each_other():
    calibration = Calibration(world_to_base=WORLD_TO_BASE, tool=TOOL)
    tool = Transform.from_rpy(np.array([0.1, 0.05, 0.1]), np.array([np.pi, 0, 0.4]))
    tcp = calibration.tcp_in_base(tool)
    again = calibration.tool_in_world(tcp)
    np.testing.assert_allclose(again.translation, tool.translation, atol=1e-12)
    # With the gripper pointing down, the TCP is the tool's length above the tool point.
    np.testing.assert_allclose(WORLD_TO_BASE.inverse().apply(tcp.translation), [0.1, 0.05, 0.272], atol=1e-12)


def test_the_tool_may_be_left_out(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("world_to_base: {translation_m: [1, 2, 3], quaternion_xyzw: [0, 0, 0, 1]}\n")
    np.testing.assert_allclose(Calibration.load(path).tool.translation, 0)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("world_to_bse: {}", "did you mean 'world_to_base'"),
        ("tool: {translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}", "lacks world_to_base"),
        (
            "world_to_base: {translation: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}",
            "did you mean 'translation_m'",
        ),
        ("world_to_base: {translation_m: [0, 0], quaternion_xyzw: [0, 0, 0, 1]}", "3 finite numbers"),
        ("world_to_base: {translation_m: [0, 0, x], quaternion_xyzw: [0, 0, 0, 1]}", "must be 3 numbers"),
        ("world_to_base: {translation_m: [0, 0, .nan], quaternion_xyzw: [0, 0, 0, 1]}", "3 finite numbers"),
        (
            "world_to_base: {translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 1, 1]}",
            r"length 1.4142, must be 1",
        ),
        ("world_to_base: 3", "must be a mapping"),
        ("- 1", "key: value"),
        ("a: [", "cannot read"),
    ],
)
def test_a_wrong_file_names_what_is_wrong(tmp_path, text, reason):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(RobotError, match=reason):
        Calibration.load(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RobotError, match=r"nowhere\.yaml"):
        Calibration.load(tmp_path / "nowhere.yaml")


def test_the_fit_recovers_a_known_transform():
    report = fit_world_to_base(POINTS, WORLD_TO_BASE.apply(POINTS))
    np.testing.assert_allclose(report.world_to_base.rotation, WORLD_TO_BASE.rotation, atol=1e-9)
    np.testing.assert_allclose(report.world_to_base.translation, WORLD_TO_BASE.translation, atol=1e-9)
    assert report.rms < 1e-9


def test_the_residual_tells_a_bad_touch():
    touched = WORLD_TO_BASE.apply(POINTS)
    touched[2, 0] += 0.03
    report = fit_world_to_base(POINTS, touched)
    assert report.rms > 0.005
    assert np.argmax(report.residuals) == 2


def test_three_points_are_enough_but_check_nothing():
    report = fit_world_to_base(POINTS[:3], WORLD_TO_BASE.apply(POINTS[:3]))
    assert report.quality == FitQuality.UNCHECKED
    assert np.isnan(report.leave_one_out)
    np.testing.assert_allclose(report.world_to_base.rotation, WORLD_TO_BASE.rotation, atol=1e-9)


@pytest.mark.parametrize(
    ("world", "base", "reason"),
    [
        (POINTS[:2], POINTS[:2], "N >= 3"),
        (POINTS, 1000 * WORLD_TO_BASE.apply(POINTS), "base points are 9.. times .* seem to be millimetres"),
        (100 * POINTS, WORLD_TO_BASE.apply(POINTS), "world points are 10. times .* seem to be centimetres"),
        (POINTS, WORLD_TO_BASE.apply(0.95 * POINTS), r"0\.950 of those between the world points; .* 100 %"),
        (POINTS[[0, 1, 2, 2]], WORLD_TO_BASE.apply(POINTS), "pair 3 and pair 4 are the same world point"),
        (POINTS, WORLD_TO_BASE.apply(POINTS) @ SWAPPED, "one frame is left-handed; are two columns swapped"),
        (ON_TABLE, WORLD_TO_BASE.apply(ON_TABLE) @ SWAPPED, "world's z pointing down in the base frame"),
        (POINTS, POINTS[:3], "two lists"),
        (np.outer(np.arange(4.0), [1, 1, 0]), POINTS, "one line"),
        (np.full((3, 3), np.nan), POINTS[:3], "finite"),
    ],
)
def test_points_that_fix_no_transform_are_refused(world, base, reason):
    with pytest.raises(RobotError, match=reason):
        fit_world_to_base(world, base)


@st.composite
def touches(draw):
    """Points at least 5 cm apart, a transform that is level within 10 degrees, and noise of 1.5 mm in a coordinate."""
    count = draw(st.integers(8, 12))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    world = random.uniform([-0.3, -0.2, 0.0], [0.3, 0.2, draw(st.sampled_from([0.0, 0.25]))], (count, 3))
    apart = np.linalg.norm(world[:, None] - world, axis=2) + np.eye(count)
    assume(apart.min() > 0.05)
    assume(np.linalg.svd(world - world.mean(axis=0), compute_uv=False)[1] > 0.08 * np.sqrt(count))
    rpy = np.array([*draw(hnp.arrays(float, 2, elements=st.floats(-0.17, 0.17))), draw(st.floats(-3.1, 3.1))])
    transform = Transform.from_rpy(draw(hnp.arrays(float, 3, elements=st.floats(-1, 1))), rpy)
    return world, transform, transform.apply(world) + random.normal(0, 0.0015, (count, 3)), random


def largest_error(report, transform, world) -> float:
    return float(np.linalg.norm(report.world_to_base.apply(world) - transform.apply(world), axis=1).max())


@settings(max_examples=40, deadline=None)
@given(touches())
def test_any_transform_is_recovered_within_the_error_that_is_predicted(touched):
    world, transform, base, _ = touched
    report = fit_world_to_base(world, base)
    assert largest_error(report, transform, world) < 5 * report.expected_error
    assert report.expected_error < 0.005
    assert report.rms <= report.leave_one_out < 0.01


@settings(max_examples=40, deadline=None)
@given(touches(), st.integers(1, 2), st.floats(0.03, 3.0))
def test_mistouched_points_are_left_out_and_never_move_the_result(touched, wrong, distance):
    world, transform, base, random = touched
    mistouched = random.choice(len(world), wrong, replace=False)
    away = random.normal(size=(wrong, 3))
    base[mistouched] += distance * away / np.linalg.norm(away, axis=1, keepdims=True)
    report = fit_world_to_base(world, base)
    assert not report.used[mistouched].any()
    # Ten standard deviations of the noise, however far off the touch was.
    assert largest_error(report, transform, world) < 0.015


def test_of_four_points_none_is_left_out_and_the_quality_says_so():
    touched = WORLD_TO_BASE.apply(POINTS)
    touched[2, 0] += 0.03
    report = fit_world_to_base(POINTS, touched)
    assert report.used.all()
    assert report.quality == FitQuality.POOR


def test_leave_one_out_is_the_error_at_a_point_that_was_not_touched():
    touched = WORLD_TO_BASE.apply(ON_TABLE) + np.random.default_rng(3).normal(0, 0.002, ON_TABLE.shape)
    report = fit_world_to_base(ON_TABLE, touched)
    others = fit_world_to_base(ON_TABLE[1:], touched[1:]).world_to_base
    assert report.left_one_out[0] == pytest.approx(np.linalg.norm(others.apply(ON_TABLE[0]) - touched[0]))


def write_pairs(path, rows, header="world_x,world_y,world_z,base_x_mm,base_y_mm,base_z_mm"):
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def test_calibrate_writes_the_file_of_the_bridge_and_keeps_its_tool(tmp_path, capsys):
    base = 1000 * WORLD_TO_BASE.apply(ON_TABLE)
    base[3, 1] += 40
    out = tmp_path / "world_to_base.yaml"
    Calibration(world_to_base=Transform.identity(), tool=TOOL).save(out)
    pairs = write_pairs(tmp_path / "pairs.csv", np.hstack([ON_TABLE, base]))
    assert main(["calibrate", str(pairs), "--out", str(out), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["points"], content["quality"], list(content["left_out_m"])) == (5, "good", ["line 5"])
    calibration = Calibration.load(out)
    np.testing.assert_allclose(calibration.world_to_base.translation, WORLD_TO_BASE.translation, atol=1e-9)
    np.testing.assert_allclose(calibration.tool.translation, TOOL.translation)
    assert calibration.record.left_out_m == {"line 5": pytest.approx(0.04, abs=1e-5)}
    assert calibration.record.date_utc.endswith("+00:00")
    # What it loaded it writes again.
    calibration.save(tmp_path / "again.yaml")
    assert Calibration.load(tmp_path / "again.yaml").record == calibration.record
    other = tmp_path / "other.yaml"
    assert main(["calibrate", str(pairs), "--out", str(other), "--tool-from", str(out)]) == 0
    assert "left out: mis-touched?" in capsys.readouterr().out
    np.testing.assert_allclose(Calibration.load(other).tool.translation, TOOL.translation)


def test_a_poor_calibration_replaces_a_good_one_only_if_forced(tmp_path, capsys):
    out = tmp_path / "world_to_base.yaml"
    Calibration(world_to_base=WORLD_TO_BASE, tool=TOOL).save(out)
    good = out.read_bytes()
    base = 1000 * WORLD_TO_BASE.apply(POINTS)
    base[2, 0] += 30
    calibrate = ["calibrate", str(write_pairs(tmp_path / "pairs.csv", np.hstack([POINTS, base]))), "--out", str(out)]
    assert main(calibrate) == 1
    assert "not written; --force writes it all the same" in capsys.readouterr().out
    assert main([*calibrate, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["calibration"] is None
    assert out.read_bytes() == good
    assert main([*calibrate, "--force"]) == 1
    assert Calibration.load(out).record is not None


def test_calibrate_takes_corners_of_the_printed_board(tmp_path, capsys):
    # The default board: 60 mm tags, 15 mm apart, the first corner at (-0.1425, 0.435, 0.001), rows towards -y.
    corners = {(0, 0): (-0.1425, 0.435), (3, 1): (0.1425, 0.435), (8, 3): (-0.1425, 0.225), (11, 2): (0.1425, 0.225)}
    rows = [(*named, *WORLD_TO_BASE.apply([x, y, 0.001]).tolist()) for named, (x, y) in corners.items()]
    pairs = write_pairs(tmp_path / "pairs.csv", rows, "tag,corner,base_x,base_y,base_z")
    assert main(["calibrate", str(pairs), "--out", str(tmp_path / "a.yaml")]) == 0
    shown = capsys.readouterr().out
    assert "tag 11 corner 2" in shown
    assert "fewer than five points" in shown
    found = Calibration.load(tmp_path / "a.yaml").world_to_base
    np.testing.assert_allclose(found.translation, WORLD_TO_BASE.translation, atol=1e-9)
    assert Board().corner_in_world(5, 0).tolist() == pytest.approx([-0.0675, 0.36, 0.001])


@pytest.mark.parametrize(
    ("header", "row", "reason"),
    [
        ("world_x,world_y,world_z,base_x,base_y", "0,0,0,0,0", "needs one column base_z .* or base_z_mm"),
        ("world_x,world_y,world_z,base_x,base_y,base_z,bas_z", "0,0,0,0,0,0,0", "'bas_z' .* did you mean base_z"),
        ("tag,corner,base_x,base_y,base_z", "99,0,0,0,0", "the board has the tags 0 to 11, not 99"),
        ("tag,corner,base_x,base_y,base_z", "1,4,0,0,0", "corners 0 to 3, clockwise from the upper left, not 4"),
        ("tag,corner,base_x,base_y,base_z", "1,0.5,0,0,0", "line 2: corner must be a whole number, got 0.5"),
        ("tag,corner,base_x,base_y,base_z", "1,0,0,0,z", "line 2: base_z must be a number, got 'z'"),
        ("tag,corner,base_x,base_y,base_z", "1,0,0,0," + "1" * 200_000, "cannot read .*pairs.csv: field larger"),
        ("tag,corner,base_x,base_y,base_z", "1,0,0,0", "line 2 has 4 values for 5 columns"),
        ("tag,corner,base_x,base_y,base_z", "1,0,0,0,0", "N >= 3"),
    ],
)
def test_calibrate_names_what_is_wrong_with_the_pairs(tmp_path, capsys, header, row, reason):
    path = tmp_path / "pairs.csv"
    path.write_text(f"{header}\n{row}\n")
    assert main(["calibrate", str(path), "--out", str(tmp_path / "a.yaml")]) == 2
    error = capsys.readouterr().err
    assert re.search(reason, error), error
    assert not (tmp_path / "a.yaml").exists()
