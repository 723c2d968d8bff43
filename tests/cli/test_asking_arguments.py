"""`egophys diagnose --ask`: what it needs, and the world of a rehearsal in which motions are done."""

import argparse
import json

import numpy as np
import pytest

from egophys_core.cli import diagnose, experiment, rehearse
from egophys_core.cli.asking_arguments import add_hand_arguments, hands_of, rehearsed_world
from egophys_core.cli.rehearsed_truth import read_truth
from egophys_core.errors import EgophysError, OptionsError
from egophys_core.experiments import PERSON, HandMotion, Proposal
from egophys_core.experiments.family import HAND_POINTS
from egophys_core.experiments.hand_path import PathWriter
from egophys_core.recording import read_episode
from tests.effects.situations import sheet
from tests.experiments.twins import twin_of


def parsed_by(module, *arguments):
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    return parser.parse_args([str(each) for each in arguments])


@pytest.mark.parametrize("given", [("--ask", "1"), ("--world", "lab"), ("--ask", "-1", "--world", "lab")])
def test_how_often_to_ask_and_where_go_together(tmp_path, given):
    with pytest.raises(OptionsError, match="--ask N and --world DIR go together"):
        diagnose.run(parsed_by(diagnose, "t.twin", "lift", "--out", tmp_path / "d", *given))


def test_limits_of_hands_that_are_not_asked_are_refused_before_anything_is_read(tmp_path):
    (tmp_path / "arm.yaml").write_text("max_speed_m_s: 0.1\n")
    out, limits = ("--out", tmp_path / "d"), ("--limits", tmp_path / "arm.yaml")
    asked = ("--ask", "1", "--world", "lab")
    for module, given, message in (
        (diagnose, ("lift", *limits), "of motions that are asked for; add --ask N"),
        (diagnose, ("lift", "--by", "arm"), "of motions that are asked for; add --ask N"),
        (diagnose, ("lift", *asked, *limits), "are an arm's; add --by arm"),
        (diagnose, ("lift", *asked, "--by", "arm", "--limits", tmp_path / "none"), "none"),
        (experiment, limits, "are an arm's; add --by arm"),
    ):
        with pytest.raises(EgophysError, match=message):
            module.run(parsed_by(module, "t.twin", *given, *out))


def test_hands_are_a_persons_or_those_of_an_arm_within_its_limits(tmp_path):
    parser = argparse.ArgumentParser()
    add_hand_arguments(parser)
    (tmp_path / "arm.yaml").write_text("max_speed_m_s: 0.1\nworkspace_max_m: [0.6, 0.3, 0.35]\n")
    assert hands_of(parser.parse_args([])) == PERSON
    arm = hands_of(parser.parse_args(["--by", "arm", "--limits", str(tmp_path / "arm.yaml")]))
    assert (arm.hands, arm.fastest_m_s, arm.highest_m) == (1, 0.1, 0.35)


def test_a_motion_is_done_with_the_object_of_the_rehearsal_and_kept(tmp_path):
    options = ("--motions", "lift", "--duration-s", "0.2", "--points", "40", "--effect", "gravity_scale")
    rehearse.run(parsed_by(rehearse, "--out", tmp_path / "lab", *options))
    rested = read_episode(tmp_path / "lab/episode_0").points[0]
    writer = PathWriter(np.append(np.nanmean(rested, axis=0)[:2], 0.01))
    writer.move([0.0, 0.0, 0.05], peak_speed=0.5)
    motion = HandMotion(name="lift it", sentence="lift it", paths=(writer.path(),), hand_points=HAND_POINTS)
    proposal = Proposal(motion=motion, score=1.0, before=(), after=())
    world = rehearsed_world(tmp_path / "lab", twin_of(sheet()), tmp_path / "d_asked")
    episode = world(proposal, 1)
    kept = read_episode(tmp_path / "d_asked/motion_1/motion_1")
    np.testing.assert_array_equal(kept.points, episode.points)
    assert episode.times[-1] == pytest.approx(motion.duration, abs=0.1)
    about = json.loads((tmp_path / "d_asked/motion_1/experiment.json").read_text())
    assert about["motions"][0]["sentence"] == "lift it"
    assert np.nanmean(episode.points[-1, :, 2]) > np.nanmean(episode.points[0, :, 2]) + 0.005


TRUTH = {
    "object": "sheet",
    "object_seed": 3,
    "effects": [{"name": "gravity_scale", "parameters": {"scale": {"value": 1.2, "unit": "1"}}}],
    "episodes": [{"folder": "episode_0", "motion": "lift", "seed": 5}],
    "options": {"object": "box", "points": 40},
}


def drag_of(**about):
    return {"effects": [{"name": "quadratic_drag", "parameters": {"coefficient": about}}]}


def test_the_truth_of_a_rehearsal_is_read(tmp_path):
    (tmp_path / "truth.json").write_text(json.dumps({**TRUTH, **drag_of(value=3, unit="1/m")}))
    truth = read_truth(tmp_path)
    assert (truth.object_seed, truth.last_seed, truth.options.points) == (3, 5, 40)
    assert truth.effects == {"quadratic_drag": {"coefficient": 3.0}}


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"options": []}, r"`options` must be a JSON object, got \[\]"),
        ({"options": None}, "`options` must be a JSON object, got None"),
        ({"options": {"point": 40}}, "unknown option 'point'; did you mean 'points'"),
        ({"object_seed": float("inf")}, "`object_seed` must be a whole number from 0 on, got inf"),
        ({"object_seed": -1}, "`object_seed` must be a whole number from 0 on, got -1"),
        ({"episodes": None}, "`episodes` must be a list, got None"),
        ({"episodes": [{"folder": "x"}]}, "`seed` must be a whole number from 0 on, got None"),
        ({"effects": {}}, "`effects` must be a list, got {}"),
        ({"effects": [{"name": 5}]}, "the `name` of an effect must be a text, got 5"),
        ({"effects": [{"name": "quadratic_drag", "parameters": []}]}, "`parameters` of quadratic_drag must be a JSON"),
        ({"effects": [{"name": "quadratic_drga", "parameters": {}}]}, "unknown effect 'quadratic_drga'; did you mean"),
        (
            drag_of(value=float("nan")),
            "quadratic_drag: coefficient must have a finite number as its `value`, got .*nan",
        ),
        (drag_of(value=10**400), "quadratic_drag: coefficient must have a finite"),
        (drag_of(value="3"), "quadratic_drag: coefficient must have a finite number"),
    ],
)
def test_a_damaged_truth_is_refused_before_a_diagnosis(tmp_path, change, text):
    (tmp_path / "truth.json").write_text(json.dumps({**TRUTH, **change}))
    with pytest.raises(OptionsError, match=f"--world .*truth.json: {text}.*; give a folder of `egophys rehearse`"):
        read_truth(tmp_path)


def test_a_folder_that_is_no_rehearsal_is_no_world(tmp_path):
    with pytest.raises(OptionsError, match="give a folder of `egophys rehearse`"):
        rehearsed_world(tmp_path, twin_of(sheet()), tmp_path / "d_asked")
    (tmp_path / "truth.json").write_text("[" * 100_000)
    with pytest.raises(OptionsError, match="give a folder of `egophys rehearse`"):
        rehearsed_world(tmp_path, twin_of(sheet()), tmp_path / "d_asked")
