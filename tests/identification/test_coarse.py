"""A coarse fit that is stopped goes on where it was, to the same twin, and from nothing but its own state."""

import dataclasses
import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from egophys_core.episode import Episode
from egophys_core.errors import OutputError, TwinError
from egophys_core.identification import FitOptions, build, coarse
from egophys_core.identification.search_state import load_search
from egophys_core.kinds.kind import Searched
from egophys_core.twin import encode_twin
from tests.identification.synthetic import sheet_episode

OPTIONS = FitOptions(generations=4, population=6, frame_stride=6, dense_steps=2)
SEED = 3


def file_of_fit(
    checkpoint: Path | None,
    *,
    generations: int = OPTIONS.generations,
    stop_after: int | None = None,
    episode: Episode | None = None,
    seed: int = SEED,
    **changes: object,
) -> bytes:
    """The file of the twin of a small fit; stopped as by Ctrl-C after some generations."""
    done = 0

    def progress(stage: str, share: float, loss: float) -> None:
        nonlocal done
        done += stage == "search"
        if done == stop_after:
            raise KeyboardInterrupt

    options = dataclasses.replace(OPTIONS, generations=generations, **changes)
    return encode_twin(
        build([episode or sheet_episode()], options, seed=seed, progress=progress, checkpoint=checkpoint)
    )


def stop(checkpoint: Path, *, after: int) -> None:
    with pytest.raises(KeyboardInterrupt):
        file_of_fit(checkpoint, stop_after=after)


@pytest.fixture(scope="module")
def never_stopped() -> bytes:
    return file_of_fit(None)


@pytest.fixture
def stopped(tmp_path) -> Path:
    """The state of a search that was stopped after two of four generations."""
    stop(tmp_path / "search", after=2)
    return tmp_path / "search"


@pytest.fixture
def evaluated(monkeypatch) -> list[int]:
    """How many candidates each evaluation had."""
    counts: list[int] = []
    evaluate = coarse.evaluate_candidates

    def counted(problems, shape, population, stride):
        counts.append(len(population))
        return evaluate(problems, shape, population, stride)

    monkeypatch.setattr(coarse, "evaluate_candidates", counted)
    return counts


def change(path: Path, changed: Callable[[dict], dict]) -> None:
    """Rewrite arrays and header of a state."""
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["header"] = json.loads(arrays["header"].tobytes())
    arrays = changed(arrays)
    arrays["header"] = np.frombuffer(json.dumps(arrays["header"]).encode(), np.uint8)
    with path.open("wb") as stream:
        np.savez(stream, **arrays)


def test_keeping_the_search_changes_nothing(never_stopped, tmp_path):
    assert file_of_fit(tmp_path / "search") == never_stopped


@pytest.mark.parametrize("after", [1, 2, 3, 4])
def test_stopped_fit_goes_on_to_the_same_twin_to_the_byte(never_stopped, tmp_path, after):
    stop(tmp_path / "search", after=after)
    assert file_of_fit(tmp_path / "search") == never_stopped


def test_fit_may_be_stopped_again_and_again(never_stopped, tmp_path):
    for after in (1, 2, 3):
        stop(tmp_path / "search", after=after)
    assert file_of_fit(tmp_path / "search") == never_stopped
    assert [path.name for path in tmp_path.iterdir()] == ["search"]


def test_killed_process_leaves_a_state_to_go_on_from(never_stopped, tmp_path):
    # SIGKILL in the third generation, before its losses are known: nothing in the process can clean up.
    program = f"""
import os, signal
from pathlib import Path
from egophys_core.identification import coarse
from tests.identification.test_coarse import file_of_fit

evaluate, generations = coarse.evaluate_candidates, []

def killed(*arguments):
    generations.append(1)
    if len(generations) == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return evaluate(*arguments)

coarse.evaluate_candidates = killed
file_of_fit(Path({str(tmp_path / "search")!r}))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert file_of_fit(tmp_path / "search") == never_stopped


def test_what_was_done_is_not_done_again(stopped, evaluated):
    file_of_fit(stopped)
    # The best candidate, to see that its loss is still the same, and the two generations that were left.
    assert evaluated == [1, 6, 6]


def test_finished_fit_returns_at_once(never_stopped, tmp_path, evaluated):
    file_of_fit(tmp_path / "search")
    content = (tmp_path / "search").read_bytes()
    evaluated.clear()
    assert file_of_fit(tmp_path / "search") == never_stopped
    assert evaluated == [1]
    assert (tmp_path / "search").read_bytes() == content


def test_finished_fit_can_have_more_generations_and_fewer(tmp_path):
    file_of_fit(tmp_path / "search")
    assert file_of_fit(tmp_path / "search", generations=6) == file_of_fit(None, generations=6)
    content = (tmp_path / "search").read_bytes()
    assert file_of_fit(tmp_path / "search", generations=2) == file_of_fit(None, generations=2)
    assert (tmp_path / "search").read_bytes() == content


def test_progress_of_a_resumed_fit_is_that_of_the_whole(stopped):
    reports: list[list[tuple[str, float, float]]] = [[], []]
    for report, checkpoint in zip(reports, (None, stopped), strict=True):
        build(
            [sheet_episode()],
            OPTIONS,
            seed=SEED,
            progress=lambda *each, report=report: report.append(each),
            checkpoint=checkpoint,
        )
    whole, resumed = ([each for each in report if each[0] == "search"] for report in reports)
    assert resumed == whole
    assert len(whole) == OPTIONS.generations


def moved_episode() -> Episode:
    episode = sheet_episode()
    points = episode.points.copy()
    points[-1, 0, 2] += 1e-3
    return dataclasses.replace(episode, points=points)


@pytest.mark.parametrize(
    ("other", "part"),
    [
        ({"seed": 4}, r"seed \(3 there, 4 here\)"),
        ({"frame_stride": 5}, r"option frame_stride \(6 there, 5 here\)"),
        ({"population": 7}, r"option population \(6 there, 7 here\)"),
        ({"step_size": 0.3}, r"option step_size \(0\.2 there, 0\.3 here\)"),
        ({"episode": moved_episode()}, r"episodes \(\['synthetic \w+'\] there, \['synthetic \w+'\] here\)"),
        ({"episode": dataclasses.replace(sheet_episode(), ground_height=-0.01)}, r"episodes \("),
    ],
)
def test_state_of_another_fit_is_refused_with_what_differs(stopped, other, part):
    content = stopped.read_bytes()
    with pytest.raises(
        TwinError, match=rf"search state .*search is of another fit: {part}.*; name another file"
    ) as error:
        file_of_fit(stopped, **other)
    assert "\n" not in str(error.value)
    assert stopped.read_bytes() == content


def test_state_of_another_version_is_refused(stopped, monkeypatch):
    change(stopped, lambda arrays: {**arrays, "header": {**arrays["header"], "format_version": 2}})
    with pytest.raises(TwinError, match="has format 2, this version reads 1"):
        file_of_fit(stopped)
    monkeypatch.setattr("egophys_core.identification.search_state.FORMAT_VERSION", 2)
    monkeypatch.setattr("egophys_core.identification.search_state.__version__", "99.0")
    with pytest.raises(TwinError, match=r"code version \(.* there, 99\.0 here\)"):
        file_of_fit(stopped)


def test_state_that_cannot_be_repeated_is_refused(stopped):
    # As from a machine or a library whose arithmetic differs in the last digit.
    original = stopped.read_bytes()
    for name, part in (
        ("populations", "CMA-ES asks for other candidates in generation 1"),
        ("losses", "its best candidate has a loss of"),
    ):
        stopped.write_bytes(original)
        with np.load(stopped) as archive:
            changed = archive[name]
        last = np.unravel_index(np.argmin(changed), changed.shape) if name == "losses" else (1, 5, 2)
        changed[last] = np.nextafter(changed[last], 0)
        change(stopped, lambda arrays, name=name, changed=changed: {**arrays, name: changed})
        with pytest.raises(TwinError, match=f"cannot be gone on from: {part}"):
            file_of_fit(stopped)


def test_damaged_state_is_refused(stopped):
    content = stopped.read_bytes()
    damaged = [b"", b"hello", content[:200], content[:-1], content[100:], file_of_fit(None)]
    for each in damaged:
        stopped.write_bytes(each)
        with pytest.raises(TwinError, match=r"search is not the state of a search, or it is damaged \("):
            file_of_fit(stopped)


def test_changed_byte_is_noticed_or_without_effect(stopped):
    content = stopped.read_bytes()
    with np.load(stopped) as archive:
        identity = json.loads(archive["header"].tobytes())["identity"]
    good = load_search(stopped, identity)
    refused = 0
    for place in range(0, len(content), 11):
        stopped.write_bytes(content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :])
        try:
            state = load_search(stopped, identity)
        except TwinError:
            refused += 1
        else:
            assert np.array_equal(state.populations, good.populations)
            assert np.array_equal(state.losses, good.losses)
    assert refused > 0.5 * len(range(0, len(content), 11))


def test_folder_in_the_place_of_the_state_is_refused(tmp_path):
    with pytest.raises(TwinError, match="is not the state of a search"):
        file_of_fit(tmp_path)


def test_state_that_cannot_be_written_is_an_error(tmp_path):
    with pytest.raises(OutputError, match=r"cannot write search state .*nowhere/search: No such file or directory"):
        file_of_fit(tmp_path / "nowhere" / "search")


def test_search_in_which_every_candidate_diverged_can_go_on(tmp_path, monkeypatch):
    monkeypatch.setattr(coarse, "evaluate_candidates", lambda _, __, population, ___: np.full(len(population), np.inf))
    with pytest.raises(TwinError, match="every candidate of the coarse fit diverged"):
        file_of_fit(tmp_path / "search", generations=2)
    monkeypatch.undo()
    # The first two generations cost nothing; what follows is what they led to.
    resumed, evaluate = [], coarse.evaluate_candidates
    monkeypatch.setattr(coarse, "evaluate_candidates", lambda *each: resumed.append(each) or evaluate(*each))
    file_of_fit(tmp_path / "search")
    assert len(resumed) == 2


def test_a_number_that_ends_at_its_bound_is_said():
    numbers = [
        Searched(name="drag", low=0.01, high=5.0, start=0.3, logarithmic=True),
        Searched(name="stiffness_rate", low=1e3, high=1e5, start=3e4, logarithmic=True),
        Searched(name="friction", low=0.0, high=1.0, start=0.5),
    ]
    assert coarse.at_bounds(numbers, np.array([0.5, 0.9, 1.0])) == ()
    (most,) = coarse.at_bounds(numbers, np.array([0.5, 1.0, 0.0]))
    assert most.startswith("stiffness_rate ended at 1e+05, the most that is searched")
    (least,) = coarse.at_bounds(numbers, np.array([0.0, 0.5, 0.0]))
    assert least.startswith("drag ended at 0.01, the least that is searched")
