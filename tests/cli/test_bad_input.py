"""What a user gets wrong: one line on standard error, exit code 2, nothing written."""

import dataclasses
import os
import shutil
import signal
import warnings

import numpy as np
import pytest

from egophys_core.recording import episode_writer, write_episode
from egophys_core.twin import load_twin, save_twin
from tests.cli.conftest import FAST_FIT, FAST_PLAN
from tests.identification.synthetic import sheet_episode


def refused(result: tuple[int, str, str], *parts: object) -> None:
    """Exit code 2, nothing on standard output, one line with all parts on standard error."""
    code, out, err = result
    assert code == 2, err
    assert out == ""
    assert err.startswith("egophys ")
    assert "Traceback" not in err
    assert len(err.strip().splitlines()) == 1
    for part in parts:
        assert str(part) in err


def test_missing_bag(egophys, tmp_path):
    refused(egophys("build", tmp_path / "no.mcap", "--out", tmp_path / "t.twin"), "egophys build:", "no.mcap")
    assert os.listdir(tmp_path) == []


def test_missing_folder_for_the_twin_is_found_before_the_fit(egophys, episode_bag, tmp_path):
    # A thousand generations would take minutes.
    out = tmp_path / "nowhere" / "t.twin"
    refused(egophys("build", episode_bag, "--out", out, "--generations", "1000"), out, "does not exist")
    refused(egophys("build", episode_bag, "--out", tmp_path, "--generations", "1000"), tmp_path, "is a folder")


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ("build {mcap} --out {mcap}", "read by the same command"),
        ("build {bag} --out {bag}/t.twin", "read by the same command"),
        ("build {bag} --out {new} --checkpoint {new}", "read by the same command"),
        ("build {bag} --out {new} --checkpoint {mcap}", ""),
        ("build {mcap} --out {new} --checkpoint {mcap}", "read by the same command"),
        ("build {bag} --out {notes}", "is not a twin"),
        ("plan {twin} --translate 0.05 0 0 --out {twin}", "read by the same command"),
        ("plan {twin} --target {bag}@3 --out {bag}/plan.json", "read by the same command"),
        ("plan {twin} --translate 0.05 0 0 --start {notes} --out {notes}", "read by the same command"),
        ("plan {twin} --translate 0.05 0 0 --out {notes}", "is not a plan"),
        ("simulate {twin} {bag} --out {bag}/new", "read by the same command"),
        ("diagnose {twin} {bag} --out {bag}/new", "read by the same command"),
        ("perceive {bag} --out {bag}/new", "read by the same command"),
        ("import {bag} --out {bag}/new", "read by the same command"),
        ("check {bag} --out {bag}/0.png", "read by the same command"),
        ("check {bag} --out {notes}", "must end in .jpg or .png"),
        ("check {bag} --out {picture}", "is not a PNG picture"),
        ("calibrate {notes} --out {notes}", "read by the same command"),
        ("calibrate {bag} --out {notes}", "is not a calibration of the robot"),
        ("calibrate-camera {bag} --out {notes}", "is not a calibration of a camera"),
        ("calibrate-camera {notes} --out {notes}", "read by the same command"),
        ("board --out {notes}", "is not a board"),
    ],
)
def test_output_replaces_neither_an_input_nor_another_file(egophys, episode_bag, twin_file, tmp_path, arguments, part):
    bag = tmp_path / "towel"
    shutil.copytree(episode_bag, bag)
    files = {"twin": tmp_path / "t.twin", "notes": tmp_path / "notes.txt", "picture": tmp_path / "p.png"}
    shutil.copy(twin_file, files["twin"])
    files["notes"].write_text("buy milk")
    files["picture"].write_text("buy milk")
    places = {**files, "bag": bag, "mcap": next(bag.glob("*.mcap")), "new": tmp_path / "new"}
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    refused(egophys(*arguments.format(**places).split()), part)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_checkpoint_that_cannot_be_used_is_found_before_the_fit(egophys, episode_bag, twin_file, tmp_path):
    def build(checkpoint, *more):
        arguments = ["--out", tmp_path / "t.twin", "--generations", "1000", "--checkpoint", checkpoint, *more]
        return egophys("build", episode_bag, *arguments)

    refused(build(tmp_path / "nowhere" / "search"), "nowhere", "does not exist")
    refused(build(tmp_path), tmp_path, "is a folder")
    content = twin_file.read_bytes()
    refused(build(twin_file), twin_file, "is not the state of a search")
    assert twin_file.read_bytes() == content
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("share", [0.02, 0.5])
def test_cut_bag_is_used_as_far_as_it_goes_or_refused(egophys, episode_bag, tmp_path, share):
    bag = tmp_path / "cut.mcap"
    content = next(episode_bag.glob("*.mcap")).read_bytes()
    bag.write_bytes(content[: int(share * len(content))])
    with warnings.catch_warnings():
        code, out, err = egophys("build", bag, "--out", tmp_path / "t.twin", *FAST_FIT)
    assert "cut.mcap" in err
    assert "byte" in err
    assert "Traceback" not in err
    assert code in (0, 2)
    assert (tmp_path / "t.twin").exists() == (code == 0)
    if code == 0:
        assert "warning:" in err
        assert "written to" in out


def test_bag_without_the_points_lists_its_topics(egophys, tmp_path):
    write_episode(sheet_episode(), tmp_path / "other", object_topic="/cloth/points")
    refused(
        egophys("build", tmp_path / "other", "--out", tmp_path / "t.twin"), "no topic /object/points", "/cloth/points"
    )


def test_hand_that_never_comes_near(egophys, tmp_path):
    episode = sheet_episode()
    far = dataclasses.replace(episode, controllers=episode.controllers + np.float32([0, 0, 1]))
    write_episode(far, tmp_path / "far")
    refused(egophys("build", tmp_path / "far", "--out", tmp_path / "t.twin"), "no hand ", "same frame and unit")
    assert not (tmp_path / "t.twin").exists()


@pytest.mark.parametrize("command", ["evaluate", "simulate"])
def test_twin_that_is_none(egophys, episode_bag, tmp_path, command):
    out = ["--out", tmp_path / "bag"] if command == "simulate" else []
    (tmp_path / "t.twin").write_bytes(b"nothing of the kind")
    refused(egophys(command, tmp_path / "t.twin", episode_bag, *out), "t.twin is not a twin file")
    refused(egophys(command, tmp_path / "no.twin", episode_bag, *out), "cannot read twin", "no.twin")
    assert not (tmp_path / "bag").exists()


LONG = "a" * 300


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ("info {long}", "no such file or folder"),
        ("plan {twin} --target {long} --out {new}", f"target {LONG}"),
        ("plan {twin} --translate 0 0 0.1 --start {long} --out {new}", f"start {LONG}: give a bag"),
        ("plan {twin} --translate 0 0 0.1 --out {long}", "File name too long; choose another name"),
        ("build {bag} --out {long}", "File name too long; choose another name"),
        ("board --out {long}", "File name too long; choose another name"),
        ("perceive {bag} --out {long}", "File name too long; choose another name"),
        ("diagnose {twin} {bag} --out {long}", "File name too long; choose another name"),
        ("experiment {twin} --out {long}", "File name too long; choose another name"),
        ("rehearse --out {long}", "File name too long; choose another name"),
        ("simulate {twin} {bag} --out {long}", "File name too long"),
        ("check {long}", f"egophys check: {LONG}: File name too long"),
    ],
)
def test_names_that_no_file_may_have(egophys, episode_bag, twin_file, tmp_path, monkeypatch, arguments, part):
    monkeypatch.chdir(tmp_path)
    places = {"long": LONG, "twin": twin_file, "bag": episode_bag, "new": tmp_path / "new"}
    refused(egophys(*arguments.format(**places).split()), part)
    assert os.listdir(tmp_path) == []


def test_cut_twin(egophys, twin_file, tmp_path):
    (tmp_path / "cut.twin").write_bytes(twin_file.read_bytes()[:-100])
    refused(egophys("info", tmp_path / "cut.twin"), "cut.twin is not a twin file, or it is cut")


def test_existing_bag_is_not_overwritten(egophys, twin_file, episode_bag, tmp_path):
    copy = tmp_path / "towel"
    shutil.copytree(episode_bag, copy)
    before = {path.name: path.read_bytes() for path in copy.iterdir()}
    refused(egophys("simulate", twin_file, episode_bag, "--out", copy), copy, "exists")
    assert {path.name: path.read_bytes() for path in copy.iterdir()} == before


def test_info_of_nothing_and_of_another_file(egophys, tmp_path):
    refused(egophys("info", tmp_path / "no"), tmp_path / "no")
    (tmp_path / "text.txt").write_text("hello")
    refused(egophys("info", tmp_path / "text.txt"), "text.txt")


def test_targets_that_are_none(egophys, twin_file, episode_bag, tmp_path):
    def plan(target, *more):
        return egophys("plan", twin_file, "--target", target, "--out", tmp_path / "plan.json", *FAST_PLAN, *more)

    refused(plan(tmp_path / "no.npy"), "cannot read target", "no.npy")
    frames = sheet_episode().frames
    refused(plan(f"{episode_bag}@999"), f"frames 0 .. {frames - 1}, not 999")
    refused(plan("present"), "the present shape is no target as it is")
    refused(plan("present translate=0,0,0.1", "--translate", "0", "0", "0.1"), "translate= stands there twice")
    refused(plan("present rotate=0,0,9", "--start", "no.txt"), "start no.txt: give a bag", "or a point cloud")
    np.save(tmp_path / "folded.npy", np.random.default_rng(0).uniform(0, 0.05, (50, 3)))
    refused(plan("present rotate=0,0,9", "--start", tmp_path / "folded.npy"), "is not in the shape that twin")
    refused(plan("present", "--translate", "0", "0", "100"), "100 m from the object", "must be in metres")
    assert not (tmp_path / "plan.json").exists()


def test_missing_folder_for_the_plan_is_found_before_planning(egophys, twin_file, episode_bag, tmp_path, monkeypatch):
    monkeypatch.setattr("egophys_core.planning.plan_to_target", lambda *_, **__: pytest.fail("planned"))
    out = tmp_path / "nowhere" / "plan.json"
    refused(egophys("plan", twin_file, "--target", episode_bag, "--out", out, *FAST_PLAN), "nowhere")


def test_missing_folder_for_the_plan(egophys, twin_file, episode_bag, tmp_path):
    out = tmp_path / "nowhere" / "plan.json"
    refused(egophys("plan", twin_file, "--target", episode_bag, "--out", out, *FAST_PLAN), out)


def test_twin_without_a_grasp_cannot_be_planned_with(egophys, twin_file, episode_bag, tmp_path):
    twin = dataclasses.replace(load_twin(twin_file), grasp=np.zeros((0, 3), np.float32))
    save_twin(twin, tmp_path / "t.twin")
    result = egophys("plan", tmp_path / "t.twin", "--target", episode_bag, "--out", tmp_path / "p.json", *FAST_PLAN)
    refused(result, "the twin has no grasp")


def test_bad_options(egophys, episode_bag, tmp_path):
    def build(*more):
        return egophys("build", episode_bag, "--out", tmp_path / "t.twin", *more)

    refused(build("--generations", "0"), "generations must be in 1 .. 10000, got 0")
    refused(build("--options", tmp_path / "no.yaml"), "no.yaml")
    refused(build("--prior", "p.safetensors"), "prior p.safetensors is used for stiffness codebook only, not dense")
    refused(build("--object", "1 2"), f"--object is a place in a video, but of {episode_bag} the points are used")
    for text, part in (
        ("generation: 3\n", "did you mean 'generations'?"),
        ("generations: many\n", "generations must be of type int, got 'many'"),
        ("- 1\n", "name: value"),
        ("kind: liquid\n", "kind must be one of auto, sheet, solid"),
    ):
        (tmp_path / "fit.yaml").write_text(text)
        refused(build("--options", tmp_path / "fit.yaml"), part)


def test_yaml_that_cannot_be_parsed(egophys, episode_bag, tmp_path):
    (tmp_path / "fit.yaml").write_text("generations: [3\n")
    code, out, err = egophys("build", episode_bag, "--out", tmp_path / "t.twin", "--options", tmp_path / "fit.yaml")
    assert (code, out) == (2, "")
    assert "cannot read options" in err
    assert "fit.yaml" in err


@pytest.mark.parametrize(
    "arguments",
    [[], ["bild"], ["build"], ["build", "x"], ["build", "x", "--out", "y", "--seed", "one"], ["info", "x", "--jsn"]],
)
def test_wrong_arguments_show_the_usage(egophys, arguments):
    code, out, err = egophys(*arguments)
    assert code == 2
    assert out == ""
    assert err.startswith("usage: egophys")


@pytest.fixture
def hears_interrupts():
    """Ctrl-C is heard, as in a shell; what a script starts in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears_interrupts")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_stop_in_the_middle_of_writing_leaves_nothing(egophys, twin_file, episode_bag, tmp_path, monkeypatch, number):
    encode = episode_writer.encode_points

    def stopped(*, stamp_ns: int, **arguments: object) -> bytes:
        if stamp_ns:
            os.kill(os.getpid(), number)
        return encode(stamp_ns=stamp_ns, **arguments)

    monkeypatch.setattr(episode_writer, "encode_points", stopped)
    code, out, err = egophys("simulate", twin_file, episode_bag, "--out", tmp_path / "bag")
    assert (code, out, err) == (130, "", "egophys simulate: stopped; nothing was written\n")
    assert os.listdir(tmp_path) == []


@pytest.mark.usefixtures("hears_interrupts")
def test_stop_while_a_subcommand_is_loaded(egophys, monkeypatch):
    monkeypatch.setattr("importlib.import_module", lambda name: os.kill(os.getpid(), signal.SIGINT))
    assert egophys("info", "x") == (130, "", "egophys info: stopped; nothing was written\n")


def test_stop_by_the_user_is_no_error_and_writes_nothing(egophys, episode_bag, tmp_path, monkeypatch):
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("egophys_core.identification.build", stopped)
    code, out, err = egophys("build", episode_bag, "--out", tmp_path / "t.twin")
    assert (code, out) == (130, "")
    assert "stopped" in err
    assert os.listdir(tmp_path) == []
