"""The calibration file and the fit that makes it."""

import numpy as np
import pytest

from egophys_core.errors import RobotError
from egophys_core.robot import Calibration, Transform, fit_world_to_base

WORLD_TO_BASE = Transform.from_rpy(np.array([0.45, -0.1, 0.02]), np.array([0.01, -0.02, 1.2]))
TOOL = Transform.from_rpy(np.array([0.0, 0.0, 0.172]), np.zeros(3))
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


def test_three_points_are_enough():
    report = fit_world_to_base(POINTS[:3], WORLD_TO_BASE.apply(POINTS[:3]))
    np.testing.assert_allclose(report.world_to_base.rotation, WORLD_TO_BASE.rotation, atol=1e-9)


@pytest.mark.parametrize(
    ("world", "base", "reason"),
    [
        (POINTS[:2], POINTS[:2], "N >= 3"),
        (POINTS, POINTS[:3], "two lists"),
        (np.outer(np.arange(4.0), [1, 1, 0]), POINTS, "one line"),
        (np.full((3, 3), np.nan), POINTS[:3], "finite"),
    ],
)
def test_points_that_fix_no_transform_are_refused(world, base, reason):
    with pytest.raises(RobotError, match=reason):
        fit_world_to_base(world, base)
