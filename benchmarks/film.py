"""From video to twin on every recorded video, against the points and hands measured while it was filmed.

    python -m benchmarks.film [VIDEO ...] [--no-twins]

Rows are kept in `results/film.json` as they are done, one after the other since `seconds` are among the figures. Videos
that are named are measured again; without names those that are missing, or have no twins yet. Definitions, all lengths
in millimetres, all of points of the perceived episode with a confidence of at least 0.5, frames paired by stamp:

- `surface_mean_mm`, `surface_p95_mm`, `coverage`: as `score_points`: each measured point is identified at rest with a
  mixture of perceived ones, which is then followed by its ids. Coverage is of the measured, that is visible, points;
  `least_coverage_second` is the least of any full second.
- `wrong_share_confident`: of these pairs of a frame and a point, the share that is more than 15 mm off.
- `hands`: perceived hands of measured ones; points of one hand stay within 0.15 m of each other all the time.
  `hand_mean_mm`: for each measured hand the mean distance from the middle of its points to that of the perceived hand
  assigned to it (assignment of least total distance), over the frames from its first contact on, which is found in the
  measured episode; null where no perceived hand is left for it, or it has no contact.
- `twin_video_te_mm`, `twin_points_te_mm`: held-out track error of twins built with default options and seed 0 from the
  perceived and from the measured episode, each on its own first 70 % of the frames; both compared with the measured
  points in the last 30 % of the frames, each point with the surface node nearest to it at rest. Each twin is driven by
  the hands of the episode that it is built from. `static_te_mm`: the last shape measured in the fitted part stays.
- `seconds`: elapsed, of perceiving alone.
- `why`: what failed, in words; the figures that it leaves out are null.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.film_errors import StampedEpisode, hand_errors, held_out_error, surface_errors
from benchmarks.kept import kept_in
from benchmarks.provenance import commit, machine
from egophys_core.cli.perception_benchmark import read_measured
from egophys_core.episode import Episode
from egophys_core.errors import EgophysError
from egophys_core.evaluation import baseline_scores
from egophys_core.files import write_json
from egophys_core.identification import build, evaluate_twin
from egophys_core.json_numbers import nulled
from egophys_core.observation import Hand, contact_flags, find_hands
from egophys_core.perception.perceive import Perceived, perceive
from egophys_core.recording import read_episode, write_episode

RECORDED = Path(__file__).resolve().parents[2] / "shared/data/video"
RESULT = Path(__file__).parent / "results/film.json"
SEED = 0
FIGURES = (
    *("video", "kind", "hands", "surface_mean_mm", "surface_p95_mm", "coverage", "least_coverage_second"),
    *("hand_mean_mm", "wrong_share_confident", "twin_video_te_mm", "twin_points_te_mm", "static_te_mm", "seconds"),
)
"""Keys of a row, beside those that say how it was made."""


def run() -> dict[str, Any]:
    """Measure what is missing; the keys of `results/film.json`."""
    return _fill((), "python -m benchmarks.run film", twins=True)


def main() -> None:
    """Measure the videos named on the command line, or all that are missing."""
    parser = argparse.ArgumentParser(description="from video to twin, against measured points and hands")
    parser.add_argument("videos", nargs="*", metavar="VIDEO", help=f"folders of {RECORDED}; default: those missing")
    parser.add_argument("--no-twins", action="store_true", help="measure perception alone, not the twins")
    parsed = parser.parse_args()
    there = {bag.name for bag in RECORDED.iterdir()}
    if unknown := set(parsed.videos) - there:
        parser.error(f"no video is called {', '.join(sorted(unknown))}; there are {', '.join(sorted(there))}")
    _fill(parsed.videos, " ".join(["python -m benchmarks.film", *sys.argv[1:]]), twins=not parsed.no_twins)


def _fill(named: Sequence[str], command: str, *, twins: bool) -> dict[str, Any]:
    rows = {row["video"]: row for row in kept_in(RESULT, {"rows": []})["rows"]}
    done = {name for name, row in rows.items() if row["has_twins"] or not twins}
    where = {"machine": machine(), "commit": commit(), "command": command}
    for bag in sorted(RECORDED.iterdir()):
        if bag.name in named or not (named or bag.name in done):
            rows[bag.name] = {**measure(bag, twins=twins), "commit": where["commit"]}
            write_json(RESULT, {"rows": [rows[name] for name in sorted(rows)], **where})
            print(rows[bag.name], flush=True)
    return {"rows": [rows[name] for name in sorted(rows)]}


def measure(bag: Path, *, twins: bool) -> dict[str, Any]:
    """The row of a video."""
    row: dict[str, Any] = {**dict.fromkeys(FIGURES), "video": bag.name, "has_twins": twins}
    truth = StampedEpisode(episode=read_episode(bag), stamps_ns=read_measured(bag).stamps_ns)
    hands = find_hands(truth.episode)
    static = baseline_scores(truth.episode, contact_flags(truth.episode, hands))["last observed shape stays"]
    row["static_te_mm"] = 1e3 * static.test_track_m
    steps, failures = [partial(_from_video, bag, truth, hands, row)], []
    if twins:
        steps.append(partial(_from_points, truth, row))
    for step in steps:
        try:
            step()
        except EgophysError as error:
            failures.append(str(error))
    return nulled({**row, "why": "; ".join(failures)})


def _from_video(bag: Path, truth: StampedEpisode, hands: Sequence[Hand], row: dict[str, Any]) -> None:
    """Write the figures of perception, and of a twin from it, into a row as they are known."""
    began = time.perf_counter()
    perceived = perceive(bag)
    row["seconds"] = time.perf_counter() - began
    row["kind"] = perceived.report.kind
    found = StampedEpisode(
        episode=_as_recorded(perceived),
        stamps_ns=perceived.start_ns + np.rint(perceived.episode.times * 1e9).astype(np.int64),
    )
    row |= surface_errors(found, truth)
    row |= hand_errors(found, [each.controllers for each in find_hands(found.episode)], truth, hands)
    if row["has_twins"]:
        twin = build([found.episode], seed=SEED)
        _, nodes = evaluate_twin(twin, found.episode)
        row["twin_video_te_mm"] = held_out_error(nodes[:, twin.model.graph.surface], found.stamps_ns, truth)


def _from_points(truth: StampedEpisode, row: dict[str, Any]) -> None:
    """Write the figures of a twin from measured points into a row."""
    twin = build([truth.episode], seed=SEED)
    row["twin_points_te_mm"] = 1e3 * twin.provenance.scores["test_track_m"]


def _as_recorded(perceived: Perceived) -> Episode:
    """What `egophys build` reads of what `egophys perceive` writes."""
    with TemporaryDirectory() as folder:
        write_episode(perceived.episode, Path(folder) / "episode", start_ns=perceived.start_ns)
        return read_episode(Path(folder) / "episode", ground_height=perceived.episode.ground_height)


if __name__ == "__main__":
    main()
