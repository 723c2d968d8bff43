"""The tutorial: its commands run in order, and what it says of them is true."""

import json

import pytest

from tests.documents import REPOSITORY, commands
from tools.renew_tutorial import PAGE, renewed, run

COMMANDS = [each.text for each in commands(PAGE)]


def test_every_command_stands_alone_and_is_followed_by_what_it_printed():
    seen = []

    def remember(command):
        seen.append(" ".join(command.replace("\\\n", " ").split()))
        return "printed"

    text = renewed(PAGE.read_text(), remember)
    assert seen == [" ".join(command.split()) for command in COMMANDS]
    assert text.count("```text\nprinted\n```") == len(COMMANDS)
    assert "```text" in PAGE.read_text()


def test_every_command_of_the_story_is_there():
    story = ["board", "info", "perceive", "build", "evaluate", "simulate", "plan", "rehearse", "diagnose"]
    assert {command.split()[1] for command in COMMANDS} == set(story)
    assert "egophys replay" in PAGE.read_text()


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_commands_run_in_order_and_the_better_twin_is_better(tmp_path):
    pytest.importorskip("mujoco", reason="needs the extra [rehearsal]")
    (tmp_path / "examples").symlink_to(REPOSITORY / "examples")
    text = renewed(PAGE.read_text(), lambda command: run(command, tmp_path))
    assert text.count("```text\n") == PAGE.read_text().count("```text\n")
    for made in ("board.pdf", "seen/overlay.mp4", "seen/contact_sheet.png", "plan.json", "diagnosis/report.html"):
        assert (tmp_path / made).stat().st_size > 100
    (injected,) = json.loads((tmp_path / "lab/truth.json").read_text())["effects"]
    found = json.loads((tmp_path / "diagnosis/diagnosis.json").read_text())
    assert found["outcome"] == "named"
    assert [each["name"] for each in found["effects"]] == [injected["name"]]

    def error(twin):
        scores = json.loads(run(f"egophys evaluate {twin} lab/episode_2 --json", tmp_path))
        return scores["all_track_m"]

    assert error("diagnosis/improved.twin") < 0.75 * error("sheet.twin")
