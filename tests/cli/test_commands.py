"""The story from a shell: build, evaluate, look, simulate, plan."""

import contextlib
import inspect
import io
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import egophys_core.cli
from egophys_core import __version__
from egophys_core.cli import import_ as import_command
from egophys_core.cli.display import print_remarks
from egophys_core.cli.main import SUBCOMMANDS, main, module_name
from egophys_core.identification import FitOptions, build, coarse
from egophys_core.identification.search_state import SEARCH_FILE
from egophys_core.perception.remarks import Level, Remark
from egophys_core.plan_file import PLAN_FILE, PlanFile, read_plan, write_plan
from egophys_core.recording import read_episode
from egophys_core.recording.vrs import import_vrs
from egophys_core.twin import TWIN_FILE, encode_twin, load_twin, save_twin
from egophys_core.waypoint_plan import WaypointPlan
from tests.cli.conftest import FAST_FIT, FAST_PLAN

BASELINES = {
    "last observed shape stays",
    "moves with nearest controller",
    "nearest controller at its best lag",
}
METRICS = {
    f"{part}_{name}"
    for part in ("train", "test", "all")
    for name in ("chamfer_m", "track_m", "two_way_chamfer_m", "iou")
}


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_every_subcommand_explains_itself(egophys, name):
    code, out, err = egophys(name, "--help")
    assert (code, err) == (0, "")
    assert SUBCOMMANDS[name] in " ".join(out.split())
    assert out.startswith(f"usage: egophys {name}")


def test_every_module_of_a_subcommand_is_listed():
    folder = Path(egophys_core.cli.__file__).parent
    commands = {path.stem for path in folder.glob("*.py") if "\ndef run(" in path.read_text()}
    assert commands == {module_name(name) for name in SUBCOMMANDS}


def test_command_explains_itself_and_tells_its_version(egophys):
    code, out, _ = egophys("--help")
    assert code == 0
    assert all(name in out for name in SUBCOMMANDS)
    assert egophys("--version")[:2] == (0, f"egophys {__version__}\n")


def test_a_misspelt_subcommand_suggests_the_nearest(egophys):
    code, out, err = egophys("diagnoze", "towel.twin")
    assert (code, out) == (2, "")
    assert "no subcommand is called 'diagnoze'; did you mean 'diagnose'?" in err
    assert "there are board, calibrate, calibrate-camera" in egophys("xyzzy")[2]


def test_what_a_command_wrote_it_writes_again(egophys, twin_file, episode_bag, tmp_path):
    search = tmp_path / "search"
    for _ in range(2):
        arguments = ["--out", tmp_path / "t.twin", "--checkpoint", search, *FAST_FIT]
        assert egophys("build", episode_bag, *arguments)[0] == 0
        assert egophys("board", "--out", tmp_path / "b.pdf")[0] == 0
    assert not TWIN_FILE.fits(search)
    assert not SEARCH_FILE.fits(twin_file)
    plan = WaypointPlan(
        times=np.array([0.0, 1.0]),
        positions=np.zeros((2, 3)),
        quaternions=np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)),
        gripper_opening=np.zeros(2),
        twin_id="t",
        predicted_cost=0.0,
    )
    write_plan(tmp_path / "plan.json", PlanFile(plan=plan, stamp_ns=1, tolerance=0.01))
    assert PLAN_FILE.fits(tmp_path / "plan.json")


def test_no_subcommand_is_an_error(egophys):
    code, out, err = egophys()
    assert (code, out) == (2, "")
    assert "COMMAND" in err


@pytest.mark.parametrize("name", ["", *SUBCOMMANDS])
def test_help_loads_nothing_slow(name):
    slow = ("numpy", "scipy", "warp", "cv2", "matplotlib", "torch", "mujoco")
    program = (
        "import sys\nfrom egophys_core.cli.main import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {slow} if name in sys.modules])"
    )
    arguments = [name, "--help"] if name else ["--help"]
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"


def test_defaults_that_help_shows_are_those_of_the_library():
    def default(function, name):
        return inspect.signature(function).parameters[name].default

    assert default(import_vrs, "camera") == import_command.CAMERA_LABEL


def test_help_of_options_shows_range_and_default(egophys):
    _, out, _ = egophys("build", "--help")
    assert "generations of CMA-ES (1 .. 10000; default 50)" in " ".join(out.split())


@pytest.mark.parametrize("name", ["build", "plan"])
def test_every_option_has_a_description(egophys, name):
    _, out, _ = egophys(name, "--help")
    assert "None" not in out


def test_built_twin_is_that_of_the_library(twin_file, episode_bag):
    options = FitOptions(generations=2, population=4, frame_stride=6, dense_steps=1)
    assert twin_file.read_bytes() == encode_twin(build([read_episode(episode_bag)], options, seed=0))


def test_build_tells_scores_of_twin_and_baselines(egophys_json, episode_bag, tmp_path):
    content = egophys_json("build", episode_bag, "--out", tmp_path / "t.twin", "--seed", 3, *FAST_FIT)
    twin = load_twin(tmp_path / "t.twin")
    assert content["twin_id"] == twin.twin_id
    assert twin.provenance.seed == 3
    assert set(content["scores"]) == {"twin", *BASELINES}
    assert set(content["scores"]["twin"]) == METRICS
    assert content["scores"]["twin"] == twin.provenance.scores
    # What the copying baseline has on the frames it copies is not a number: null, as JSON has no NaN.
    assert content["scores"]["last observed shape stays"]["train_track_m"] is None


def test_build_shows_a_table_in_millimetres(egophys, episode_bag, tmp_path):
    code, out, err = egophys("build", episode_bag, "--out", tmp_path / "t.twin", *FAST_FIT)
    assert (code, err) == (0, "")
    twin = load_twin(tmp_path / "t.twin")
    assert f"twin {twin.twin_id} written to" in " ".join(out.split())
    assert f"{1000 * twin.provenance.scores['test_track_m']:.1f}" in out
    assert "last observed shape stays" in out


def test_options_come_from_a_file_and_arguments_win(egophys_json, episode_bag, tmp_path):
    (tmp_path / "fit.yaml").write_text("generations: 1\npopulation: 4\nframe_stride: 10\ndense_steps: 0\nkind: sheet\n")
    out = tmp_path / "t.twin"
    egophys_json("build", episode_bag, "--out", out, "--options", tmp_path / "fit.yaml", "--frame-stride", "6")
    settings = load_twin(out).provenance.settings
    assert (settings["generations"], settings["frame_stride"], settings["kind"]) == (1, 6, "sheet")


def test_evaluate_tells_the_scores_the_twin_was_built_with(egophys_json, twin_file, episode_bag):
    content = egophys_json("evaluate", twin_file, episode_bag)
    twin = load_twin(twin_file)
    assert {name: content[name] for name in METRICS} == twin.provenance.scores
    assert content["twin_id"] == twin.twin_id
    assert content["episode"] == "towel"
    assert content["warning"] == ""
    assert set(content["baselines"]) == BASELINES


def test_a_twin_that_predicts_worse_than_no_physics_says_so(egophys, twin_file, episode_bag, tmp_path):
    twin, slack = load_twin(twin_file), tmp_path / "slack.twin"
    parameters = replace(twin.model.parameters, controller_stiffness=1e-3)
    save_twin(replace(twin, model=replace(twin.model, parameters=parameters)), slack)
    _, out, _ = egophys("evaluate", slack, episode_bag)
    assert "warning: this twin predicts worse than no physics: it is off by" in out


def test_stopped_build_says_how_to_go_on_and_does(egophys, episode_bag, tmp_path, monkeypatch):
    search, out, whole = tmp_path / "search", tmp_path / "t.twin", tmp_path / "whole.twin"
    arguments = ["build", episode_bag, *FAST_FIT, "--checkpoint", search]
    save_search = coarse.save_search

    def stop_after_saving(*state: object) -> None:
        save_search(*state)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(coarse, "save_search", stop_after_saving)
        code, shown, err = egophys(*arguments, "--out", out)
    assert (code, shown) == (130, "")
    assert err == f"egophys build: stopped; the same command goes on from {search}\n"
    assert not out.exists()
    assert egophys(*arguments, "--out", out)[0] == 0
    assert egophys("build", episode_bag, *FAST_FIT, "--out", whole)[0] == 0
    assert out.read_bytes() == whole.read_bytes()


def test_evaluate_without_json_is_a_table(egophys, twin_file, episode_bag):
    code, out, err = egophys("evaluate", twin_file, episode_bag)
    assert (code, err) == (0, "")
    assert "test TE" in out
    assert "mm" in out
    scores = load_twin(twin_file).provenance.scores
    assert "test IoU" in out
    assert f"{scores['test_iou']:.3f}" in out
    assert f"{1000 * scores['test_two_way_chamfer_m']:.1f}" in out


def test_twin_of_a_version_without_some_scores_is_still_read(egophys, egophys_json, twin_file, episode_bag, tmp_path):
    twin = load_twin(twin_file)
    scores = {name: value for name, value in twin.provenance.scores.items() if "iou" not in name}
    save_twin(replace(twin, provenance=replace(twin.provenance, scores=scores)), tmp_path / "old.twin")
    assert egophys_json("info", tmp_path / "old.twin")["provenance"]["scores"] == scores
    assert (
        egophys_json("evaluate", tmp_path / "old.twin", episode_bag)["test_iou"] == twin.provenance.scores["test_iou"]
    )
    assert egophys("evaluate", tmp_path / "old.twin", episode_bag)[0] == 0


def test_info_of_a_twin(egophys, egophys_json, twin_file):
    content = egophys_json("info", twin_file)
    twin = load_twin(twin_file)
    assert content["twin_id"] == twin.twin_id
    assert content["nodes"] == 25
    assert content["springs"] == len(twin.model.graph.springs)
    assert content["parameters"]["stiffness"] == twin.model.parameters.stiffness
    assert content["provenance"]["episodes"][0]["name"] == "towel"
    code, out, _ = egophys("info", twin_file)
    assert code == 0
    assert twin.twin_id in out


@pytest.mark.parametrize("form", [[], ["--json"]], ids=["table", "json"])
def test_output_that_nobody_reads_ends_the_command_quietly(twin_file, monkeypatch, form):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as output:
        monkeypatch.setattr("sys.stdout", output)
        assert main(["info", str(twin_file), *form]) == 141


def test_output_that_cannot_be_written_ends_the_command_with_a_line(twin_file):
    python = [sys.executable, "-m", "egophys_core.cli.main"]
    info = f"{shlex.join(python)} info {twin_file}"
    environment = {**os.environ, "PYTHONUNBUFFERED": ""}

    def run(command: str) -> tuple[int, str, str]:
        done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60, env=environment)
        return done.returncode, done.stdout, done.stderr

    assert run(f"{info} > /dev/full") == (2, "", "egophys info: standard output: No space left on device\n")
    # Nobody asks for an output that is closed.
    assert run(f"{info} >&-") == (0, "", "")
    assert run(f"{shlex.join(python)} info none >&- 2>&-") == (2, "", "")


def test_brackets_in_names_are_shown_as_they_are(egophys, episode_bag, tmp_path, capsys):
    for name in ("m[lift]/e[bold].mcap", "k[/b].mcap"):
        bag = tmp_path / name
        bag.parent.mkdir(exist_ok=True)
        shutil.copy(next(episode_bag.glob("*.mcap")), bag)
        with contextlib.chdir(tmp_path):
            code, out, _ = egophys("info", name)
        assert code == 0
        assert out.startswith(name)
    print_remarks("[a] :dog:", [Remark(name="[b]", level=Level.OK, text="[/c]")])
    shown = capsys.readouterr().out
    assert all(each in shown for each in ("[a] :dog:", "[b]", "[/c]"))


def test_names_that_the_encoding_of_the_output_lacks(egophys, episode_bag, tmp_path, monkeypatch):
    bag = tmp_path / "fünf\udcff"
    shutil.copytree(episode_bag, bag)
    with io.TextIOWrapper(io.BytesIO(), encoding="ascii") as stream, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", stream)
        assert main(["info", str(bag)]) == 0
        stream.seek(0)
        assert "f\\xfcnf\\udcff" in "".join(stream.read().split("\n")).replace(" ", "")


def test_info_of_a_bag(egophys, egophys_json, episode_bag):
    frames = read_episode(episode_bag).frames
    content = egophys_json("info", episode_bag)
    assert {(topic["name"], topic["type"], topic["messages"]) for topic in content["topics"]} == {
        ("/object/points", "sensor_msgs/msg/PointCloud2", frames),
        ("/controller/points", "sensor_msgs/msg/PointCloud2", frames),
    }
    code, out, _ = egophys("info", episode_bag)
    assert code == 0
    assert "/object/points" in out


def test_simulated_bag_scores_as_the_twin_does(egophys, egophys_json, twin_file, episode_bag, tmp_path):
    code, out, err = egophys("simulate", twin_file, episode_bag, "--out", tmp_path / "predicted")
    assert (code, err) == (0, "")
    observed, predicted = read_episode(episode_bag), read_episode(tmp_path / "predicted")
    assert f"{observed.frames} frames of 25 points" in out
    assert predicted.points.shape == observed.points.shape
    assert np.array_equal(predicted.controllers, observed.controllers)
    errors = np.linalg.norm(predicted.points - observed.points, axis=2).mean(axis=1)
    scores = egophys_json("evaluate", twin_file, episode_bag)
    assert errors[observed.train_frames :].mean() == pytest.approx(scores["test_track_m"], rel=0.01)


def test_plan_to_a_shape_and_to_another(egophys, twin_file, episode_bag, tmp_path):
    out = tmp_path / "plan.json"
    arguments = ["plan", twin_file, "--out", out, "--seed", "4", *FAST_PLAN, "--tolerance-m", "0.05"]
    code, text, err = egophys(*arguments, "--target", episode_bag)
    assert (code, err) == (0, "")
    assert "before" in text
    made = read_plan(out)
    assert made.plan.twin_id == load_twin(twin_file).twin_id
    assert 0 < time.time_ns() - made.stamp_ns < 600e9

    def planned_to(*target):
        egophys(*arguments, *target)
        return read_plan(out).plan.positions.tolist()

    again = planned_to("--target", episode_bag)
    assert again == made.plan.positions.tolist()
    assert planned_to("--target", f"{episode_bag}@20") != again
    np.save(tmp_path / "target.npy", read_episode(episode_bag).points[-1])
    assert planned_to("--target", tmp_path / "target.npy") == again
    edited = planned_to("--translate", "0.05", "0", "-0.01", "--rotate", "0", "0", "20")
    assert edited == planned_to("--target", "present rotate=0,0,20 translate=0.05,0,-0.01") != again


def test_a_plan_begins_where_a_bag_shows_the_object(egophys, twin_file, episode_bag, tmp_path):
    def grasped(*start):
        out = tmp_path / "plan.json"
        code, _, err = egophys(
            "plan", twin_file, "--out", out, *FAST_PLAN, "--translate", "0", "0", "0.02", "--tolerance-m", "1", *start
        )
        assert (code, err) == (0, "")
        return read_plan(out).plan.positions[1]

    episode, own = read_episode(episode_bag), grasped()
    corner = int(np.argmin(np.linalg.norm(episode.points[0] - own, axis=1)))
    there = grasped("--start", episode_bag)
    assert there - own == pytest.approx(episode.points[-1, corner] - episode.points[0, corner], abs=0.02)
    np.save(tmp_path / "aside.npy", episode.points[0] + np.float32([0.1, 0.05, 0.0]))
    assert grasped("--start", tmp_path / "aside.npy") - own == pytest.approx([0.1, 0.05, 0.0], abs=0.006)


def test_a_plan_that_ends_farther_than_tolerated_is_a_finding(egophys, twin_file, tmp_path):
    arguments = ["plan", twin_file, "--out", tmp_path / "plan.json", *FAST_PLAN, "--translate", "0", "0", "1.5"]
    code, text, err = egophys(*arguments)
    assert (code, err) == (1, "")
    assert "30.0 mm tolerated: not reached" in text
    assert not read_plan(tmp_path / "plan.json").reached


@pytest.mark.slow
def test_fresh_process_prints_json_alone_also_while_kernels_compile(twin_file, episode_bag, tmp_path):
    # Nothing is cached, so Warp compiles, and says so somewhere else than on standard output.
    done = subprocess.run(
        [sys.executable, "-m", "egophys_core.cli.main", "evaluate", str(twin_file), str(episode_bag), "--json"],
        capture_output=True,
        text=True,
        env={**os.environ, "WARP_CACHE_PATH": str(tmp_path / "cache")},
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert set(json.loads(done.stdout)) >= METRICS
    assert done.stderr == ""


def test_installed_command_is_this_one():
    command = shutil.which("egophys", path=os.path.dirname(sys.executable))
    assert command is not None
    done = subprocess.run([command, "--version"], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == f"egophys {__version__}\n"
