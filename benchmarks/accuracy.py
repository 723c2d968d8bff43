"""Held-out errors of every episode of `open` and `blind`: baselines, coarse fit, dense refinement.

Every episode is fitted on its own, on its first 70 % of frames. Rows go to a file as they are done, so the work can be
stopped and goes on where it was; processes share it, one a core.
"""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.side_by_side import side_by_side
from egophys_core.evaluation import Scores, baseline_scores, score
from egophys_core.files import write_json
from egophys_core.identification import FitOptions
from egophys_core.identification.building import predict
from egophys_core.identification.coarse import fit_coarse
from egophys_core.identification.dense import DenseRefinement
from egophys_core.identification.surface_fit import shape_to_search
from egophys_core.observation import observe_episode, prepare
from egophys_core.recording import read_episode

DATA = Path(__file__).resolve().parents[2] / "shared/data"
ROWS = Path(__file__).resolve().parents[1] / "out/accuracy.json"
BUDGETS = (25, 50, 100, 200)
SEED = 0
GENERATIONS = 20
"""The paper takes 50: with these, 52 episodes take an hour instead of two."""


def run() -> list[dict[str, Any]]:
    """The rows of all episodes; those missing in the file are measured first."""
    rows = json.loads(ROWS.read_text()) if ROWS.exists() else []
    done = {row["episode"] for row in rows if row["model"] == f"dense-{BUDGETS[-1]}"}
    rows = [row for row in rows if row["episode"] in done]
    missing = [path for path in episode_paths() if episode_name(path) not in done]
    ROWS.parent.mkdir(exist_ok=True)
    for _, measured in side_by_side(measure, missing):
        rows = sorted([*rows, *measured], key=lambda row: row["episode"])
        write_json(ROWS, rows)
        print(f"{len({row['episode'] for row in rows})} episodes", flush=True)
    return rows


def episode_paths() -> list[Path]:
    """All episodes, the first of every object before the second of any: a part of the table covers all objects."""
    paths = [path for folder in ("open", "blind") for path in sorted((DATA / folder).glob("*/episode_*.mcap"))]
    return sorted(paths, key=lambda path: path.name)


def episode_name(path: Path) -> str:
    """Such as open/towel_none/episode_0."""
    return "/".join(path.with_suffix("").parts[-3:])


def measure(path: Path) -> list[dict[str, Any]]:
    """Rows of one episode; errors in metres, minutes of elapsed time on one of two busy cores."""
    episode, options, name = read_episode(path), FitOptions(generations=GENERATIONS), episode_name(path)
    observed = observe_episode(episode)
    shape = shape_to_search([observed], options)

    def row(model: str, scores: Scores, minutes: float) -> dict[str, Any]:
        errors = {
            "train_cd_m": scores.train_chamfer_m,
            "test_cd_m": scores.test_chamfer_m,
            "train_te_m": scores.train_track_m,
            "test_te_m": scores.test_track_m,
        }
        finite = {key: value if np.isfinite(value) else None for key, value in errors.items()}
        return {"episode": name, "kind": shape.kind, "model": model, **finite, "minutes": minutes}

    static, follow, _ = baseline_scores(episode, observed.contact).values()
    rows = [row("static", static, 0.0), row("rigid-follow", follow, 0.0)]

    began = time.perf_counter()
    problem = prepare(observed, shape.positions, shape.surface, spacing=shape.spacing)
    coarse = fit_coarse([problem], shape, options, seed=SEED, progress=lambda share, loss: None)

    def errors(model: Any) -> Scores:
        return score(predict(model, problem), shape.surface, episode)

    rows.append(row("coarse", errors(coarse.model), (time.perf_counter() - began) / 60))
    for budget, refinement, minutes in _refinements(DenseRefinement([problem], coarse.model, options)):
        rows.append(row(f"dense-{budget}", errors(refinement.best), minutes))
    return rows


def _refinements(refinement: DenseRefinement) -> Iterator[tuple[int, DenseRefinement, float]]:
    """The refinement after each budget of steps, and its minutes, without those of the coarse fit."""
    seconds = 0.0
    for budget in BUDGETS:
        began = time.perf_counter()
        while len(refinement.history) < budget:
            refinement.step()
        seconds += time.perf_counter() - began
        yield budget, refinement, seconds / 60
