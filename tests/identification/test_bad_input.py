"""What is wrong with observed data: one error that says what, where and what next, or a stated handling.

Each case goes through `build`, and as a recorded bag through the command.
"""

import dataclasses
import re
from collections.abc import Callable

import numpy as np
import pytest

from egophys_core.cli.main import main
from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.identification import FitOptions, build, evaluate_twin
from egophys_core.recording import write_episode
from egophys_core.twin import Twin, connected_components
from tests.identification.synthetic import episode_of, sheet_episode
from tests.simulation.scenes import sheet_positions

FAST = FitOptions(generations=1, population=4, frame_stride=6, dense_steps=0)
CORNER = 24
"""The point of the synthetic sheet that is taken hold of."""


def built(episode: Episode, **changes: object) -> Twin:
    return build([episode], dataclasses.replace(FAST, **changes), seed=0)


def scaled(factor: float, *, points: bool = True, controllers: bool = True) -> Callable[[], Episode]:
    """The sheet's episode in another unit."""

    def make() -> Episode:
        episode = sheet_episode()
        return dataclasses.replace(
            episode,
            points=episode.points * np.float32(factor if points else 1),
            controllers=episode.controllers * np.float32(factor if controllers else 1),
        )

    return make


def part(frames: slice) -> Callable[[], Episode]:
    """Some frames of the sheet's episode."""
    return lambda: episode_of(sheet_episode().points[frames], sheet_episode().controllers[frames])


def hidden(frames: slice, points: slice = slice(None)) -> Callable[[], Episode]:
    """The sheet's episode with NaN for some points in some frames."""

    def make() -> Episode:
        changed = sheet_episode().points.copy()
        changed[frames, points] = np.nan
        return episode_of(changed, sheet_episode().controllers)

    return make


def away() -> Episode:
    episode = sheet_episode()
    return dataclasses.replace(episode, controllers=episode.controllers + np.float32([0, 0, 2]))


def without_controllers() -> Episode:
    episode = sheet_episode()
    return dataclasses.replace(episode, controllers=episode.controllers[:, :0], controller_ids=np.zeros(0, np.uint32))


def at_one_place() -> Episode:
    """Every point where the corner is."""
    return episode_of(np.repeat(sheet_episode().points[:, [CORNER]], 9, axis=1), sheet_episode().controllers)


REFUSED = {
    "first frame NaN": (hidden(slice(0, 1)), "no object point is visible in the first frame"),
    "NaN from frame 35 on": (
        hidden(slice(35, None)),
        r"of the object points seen in frame 0 none is seen in frames \d+ \.\. \d+, the last that are fitted; crop",
    ),
    "single frame": (part(slice(1)), r"1 frame\(s\); motion needs at least 2"),
    "two frames": (part(slice(2)), "2 frames leave 0 to fit and 1 to hold out; record at least 4"),
    "no controllers": (without_controllers, "no controller points, so nothing moves the object; record the points"),
    "controllers far away": (
        away,
        "no hand .*; check that object and controller points are in the same frame and unit",
    ),
    "millimetres": (scaled(1000), r"a coordinate of 1\d\d m among the points, .* metres: divide millimetres by 1000"),
    "points in millimetres": (
        scaled(1000, controllers=False),
        r"a coordinate of 1\d\d m among the points, .*divide millimetres by 1000",
    ),
    "controllers in millimetres": (
        scaled(1000, points=False),
        r"a coordinate of 2\d\d m among the controllers, .*divide millimetres by 1000",
    ),
    "centimetres": (
        scaled(100),
        r"a coordinate of 2\d\.\d m among the controllers, .*divide .*centimetres by 100",
    ),
    "divided by 1000 twice": (scaled(1e-3), r"the object is 0\.0002\d+ m across, .*divided by 1000 twice, do it once"),
    "all points at one place": (at_one_place, r"the object is 0 m across, a twin is built of objects of 0\.01"),
}


@pytest.mark.parametrize(("make", "text"), REFUSED.values(), ids=REFUSED)
def test_refused_by_the_library(make, text):
    with pytest.raises(EpisodeError, match=f"^synthetic: {text}") as error:
        built(make())
    assert "\n" not in str(error.value)


RECORDED = {
    **REFUSED,
    # Said by the reader, which drops controllers that are not tracked.
    "no controllers": (without_controllers, "no controller on /controller/points is seen throughout"),
}


@pytest.mark.parametrize(("make", "text"), RECORDED.values(), ids=RECORDED)
def test_refused_by_the_command(make, text, tmp_path, monkeypatch, capsys):
    with monkeypatch.context() as patched:
        # So that there is a bag of what cannot be an episode.
        patched.setattr(Episode, "__post_init__", lambda self: None)
        write_episode(make(), tmp_path / "synthetic")
    arguments = ["--generations", "1", "--population", "4", "--out", str(tmp_path / "t.twin")]
    assert main(["build", str(tmp_path / "synthetic"), *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = [line for line in captured.err.splitlines() if not line.startswith("warning: ")]
    assert len(lines) == 1
    assert re.search(text, lines[0])
    assert not (tmp_path / "t.twin").exists()


def test_evaluation_refuses_another_unit_and_no_controllers():
    twin = built(sheet_episode())
    for make in (scaled(100), without_controllers):
        with pytest.raises(EpisodeError, match="synthetic: "):
            evaluate_twin(twin, make())


def test_evaluation_refuses_another_object():
    twin = built(sheet_episode())
    # A sheet three times as large.
    other = scaled(3.0)()
    with pytest.raises(EpisodeError, match=r"^synthetic: half of the points at rest lie \d+ mm or more from"):
        evaluate_twin(twin, other)


def test_nan_is_a_point_not_seen():
    # Of one point one coordinate is NaN from frame 20 on, another is never seen, a third only in frame 0.
    episode = hidden(slice(None), slice(1))()
    points = episode.points.copy()
    points[20:, 3, 1] = np.nan
    points[1:, 7] = np.nan
    twin = built(episode_of(points, episode.controllers))
    # The object has nodes where something was seen most of the time before it was touched.
    assert len(twin.model.graph.positions) == 23
    assert np.isfinite(list(twin.provenance.scores.values())).all()


def test_points_that_coincide_become_one_node_without_springs_of_no_length():
    episode = sheet_episode()
    twin = built(episode_of(np.concatenate([episode.points, episode.points], axis=1), episode.controllers))
    graph = twin.model.graph
    assert len(graph.positions) == 25
    assert graph.rest_lengths.min() > 0.03
    assert np.isfinite(list(twin.provenance.scores.values())).all()


def test_controller_on_a_node_holds_it_by_a_spring_of_no_length():
    # Its direction is undefined where both are at one place; nothing may become NaN there.
    episode = sheet_episode()
    arrival = np.maximum(12 - np.arange(episode.frames), 0)[:, None, None] * [0.0, 0.0, 0.02]
    on_it = np.repeat(episode.points[:, [CORNER]], 2, axis=1) + arrival
    twin = built(episode_of(episode.points, on_it))
    _, predicted = evaluate_twin(twin, episode_of(episode.points, on_it))
    assert np.isfinite(predicted).all()
    # The held node goes where the controller goes.
    assert np.linalg.norm(predicted[-1, CORNER] - on_it[-1, 0]) < 0.02


def test_object_in_two_pieces_is_joined_to_one():
    # Two halves farther apart than any spring the search may choose, lifted together by a hand at one end.
    half = sheet_positions(4, 0.03, 0.004)
    object_points = np.concatenate([half, half + np.float32([0.25, 0, 0])])
    frames = np.arange(45)
    lifted = np.maximum(frames - 18, 0)[:, None, None] * [0.0, 0.0, 0.004]
    reach = np.maximum(12 - frames, 0)[:, None, None] * [0.0, 0.0, 0.02]
    controllers = np.tile(object_points[0] + [0, 0, 0.01], (45, 3, 1)) + reach + lifted
    twin = built(episode_of(object_points + lifted, controllers), kind="sheet")
    graph = twin.model.graph
    assert connected_components(len(object_points), graph.springs).max() == 0
    across = (graph.springs[:, 0] < 16) & (graph.springs[:, 1] >= 16)
    assert across.any()
    assert graph.rest_lengths[across].min() > 0.15


def test_hand_that_stays_away_holds_nothing_while_another_does():
    episode = sheet_episode()
    both = np.concatenate([episode.controllers, episode.controllers + np.float32([0, 0, 1])], axis=1)
    twin = built(episode_of(episode.points, both))
    assert np.array_equal(twin.grasp, built(episode).grasp)
