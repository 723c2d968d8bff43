"""`egophys execute` against the emulator's process, with the real SDK and without ROS."""

import time
from pathlib import Path

import pytest

from egophys_core.cli.main import main
from egophys_core.plan_file import PlanFile, write_plan
from tests.xarm_bridge.conftest import NEAR_THE_PLANS
from tests.xarm_bridge.emulator_process import CALIBRATION, EmulatorProcess, loopback_addresses, make_plan

PLAN = make_plan([[0.0, 0.0, 0.1], [0.05, 0.0, 0.1]], [0.0, 0.5])


@pytest.fixture(scope="module")
def emulator():
    process = EmulatorProcess(next(loopback_addresses()), NEAR_THE_PLANS)
    yield process
    process.close()


@pytest.fixture
def words(emulator, tmp_path):
    """Good arguments."""
    plan, calibration = tmp_path / "plan.json", tmp_path / "calibration.yaml"
    write_plan(plan, PlanFile(plan=PLAN, stamp_ns=time.time_ns(), tolerance=0.01))
    CALIBRATION.save(calibration)
    return ["execute", str(plan), "--robot-ip", emulator.host, "--calibration", str(calibration), "--allow-emulator"]


def test_a_plan_file_is_executed(words, capsys):
    assert main([*words, "--check"]) == 0
    assert "may be executed" in capsys.readouterr().out
    assert main(words) == 0
    assert "the tool stands 0.0 mm from the last waypoint" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (["--max-age", "1e-9"], "at most 1e-09 s may pass (--max-age)"),
        (["--robot-ip", "127.200.200.200"], "no xArm controller"),
        (["--calibration", "/nowhere.yaml"], "cannot read /nowhere.yaml"),
        (["--driver", "nowhere:Arm"], "no driver 'nowhere:Arm'"),
        (["--params-file", "slow"], "speed 0.100 m/s exceeds 0.05 m/s"),
    ],
)
def test_what_cannot_be_executed_is_refused(words, more, reason, tmp_path, capsys):
    if more[1] == "slow":
        more[1] = str(tmp_path / "bridge.yaml")
        (tmp_path / "bridge.yaml").write_text("/**:\n  ros__parameters: {max_speed_m_s: 0.05, base_frame: base}\n")
    assert main([*words, *more]) == 2
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize("age", ["nan", "-5", "inf", "old"])
def test_an_age_is_seconds_from_zero_on(capsys, age):
    with pytest.raises(SystemExit) as stopped:
        main(["execute", "plan.json", "--robot-ip", "127.0.0.1", "--calibration", "c.yaml", "--max-age", age])
    assert stopped.value.code == 2
    assert f"--max-age: must be seconds from 0 on, 0 for any age, got '{age}'" in capsys.readouterr().err


def test_a_plan_without_a_stamp_is_refused(words, capsys):
    write_plan(Path(words[1]), PlanFile(plan=PLAN, stamp_ns=0, tolerance=0.01))
    assert main(words) == 2
    assert "its stamp is 0); stamp it, or set --max-age to 0" in capsys.readouterr().err


def test_an_emulator_is_not_taken_for_an_arm(words, capsys):
    assert main(words[:-1]) == 2
    assert "is an emulator" in capsys.readouterr().err
