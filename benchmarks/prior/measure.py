"""What every model makes of every item, from the same coarse fit: a row a model and item, kept as it is done.

A row says which coarse fit it began with, so that rows of several runs can stand in one table.
"""

import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.prior.anchors import OPTIONS, SEED, AnchoredItem, anchor_id, prepared, read_anchored
from benchmarks.prior.dataset import FOLDER
from benchmarks.prior.items import Item
from benchmarks.prior.spring_gaus import fit_spring_gaus
from benchmarks.provenance import commit
from benchmarks.side_by_side import side_by_side
from egophys_core.errors import SimulationError
from egophys_core.evaluation import Scores, baseline_scores, score
from egophys_core.evaluation.baselines import BASELINES
from egophys_core.files import write_json
from egophys_core.identification.building import predict
from egophys_core.identification.coarse import fit_coarse
from egophys_core.identification.dense import DenseRefinement
from egophys_core.observation import observe_episode
from egophys_core.prior import load_codebook, with_prior
from egophys_core.recording import read_episode
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import Codebook, ObjectModel

ROWS = FOLDER.parent / "rows"

COARSE = "coarse anchor only"
CODEBOOK = "codebook K=4"
LEARNED = (CODEBOOK, "codebook K=8", "codebook K=16", "static codebook", "direct MLP")
"""By the names under which `train` keeps their checkpoints."""

DENSE = {f"dense {steps} steps": steps for steps in (10, 25, 50, 100, 200)}
REFINED = {f"{CODEBOOK}, then dense {steps} steps": steps for steps in (10, 25)}
SPRING_GAUS = "Spring-Gaus"
SEARCHED = "coarse search with codebook K=4"

NAMES = {
    "train_chamfer_m": "train_cd_m",
    "test_chamfer_m": "test_cd_m",
    "train_track_m": "train_te_m",
    "test_track_m": "test_te_m",
}

COST_ROLLOUTS = 8
COST_REPEATS = 3


def checkpoint(folder: Path, name: str) -> Path:
    """Where the codebook of a model is that was trained in a folder."""
    return folder / f"{name.replace(' ', '_')}.safetensors"


def measure_all(
    items: list[Item],
    models: list[str],
    *,
    anchors: Path,
    trained: Path,
    rows: Path = ROWS,
    workers: int,
    report: Callable[[str, int, int], None],
) -> None:
    """Measure what is missing of some models on some items."""
    measure = partial(measure_item, models=models, anchors=anchors, trained=trained, rows=rows)
    for done, (item, _) in enumerate(side_by_side(measure, items, workers=workers), 1):
        report(item.name, done, len(items))


def measure_item(item: Item, models: list[str], anchors: Path, trained: Path, rows: Path) -> None:
    """Rows of one item, of those models that have none yet which begins with its present coarse fit."""
    anchor = anchor_id(item, anchors)
    missing = [name for name in models if not _is_measured(rows, item, name, anchor)]
    if not missing:
        return
    anchored = read_anchored(item, anchors)
    codebook = load_codebook(checkpoint(trained, CODEBOOK))
    for budgets, model in ((DENSE, anchored.model), (REFINED, with_prior(anchored.model, codebook)[0])):
        wanted = [name for name in budgets if name in missing]
        steps = refined(anchored, model, [budgets[name] for name in wanted])
        for name, (best, seconds) in zip(wanted, steps, strict=True):
            _keep(rows, item, anchored, name, best, seconds)
    if SPRING_GAUS in missing:
        fit = fit_spring_gaus(anchored)
        keep_scores(rows, item, SPRING_GAUS, fit.scores, fit.seconds, anchor=anchored.anchor)
    for name in (name for name in missing if name not in (*DENSE, *REFINED, SPRING_GAUS)):
        began = time.process_time()
        model = _model(name, anchored, trained)
        _keep(rows, item, anchored, name, model, time.process_time() - began)


def refined(anchored: AnchoredItem, model: ObjectModel, budgets: list[int]) -> Iterator[tuple[ObjectModel, float]]:
    """The best model after each budget of dense steps, and the CPU seconds up to there."""
    refinement, seconds = DenseRefinement([anchored.problem], model, OPTIONS), 0.0
    for budget in budgets:
        began = time.process_time()
        while len(refinement.history) < budget:
            refinement.step()
        seconds += time.process_time() - began
        yield refinement.best, seconds


def read_rows(rows: Path = ROWS) -> list[dict[str, Any]]:
    """Those that are there."""
    return [json.loads(path.read_text()) for path in sorted(rows.glob("*.json"))]


def _is_measured(rows: Path, item: Item, model: str, anchor: str) -> bool:
    """Whether there is a row of a model on an item that began with this coarse fit."""
    path = _path(rows, item, model)
    return path.exists() and json.loads(path.read_text())["anchor"] == anchor


def rollout_cost_ratio(anchored: list[AnchoredItem], codebook: Codebook) -> dict[str, Any]:
    """CPU time of a batch of rollouts with a codebook over that of the same batch without: median, and each."""
    ratios = []
    for each in anchored:
        pair = (each.model, with_prior(each.model, codebook)[0])
        seconds = np.array([[_seconds(each, model) for model in pair] for _ in range(COST_REPEATS)]).min(axis=0)
        ratios.append(float(seconds[1] / seconds[0]))
    return {"rollout_cost_ratio": float(np.median(ratios)), "rollout_cost_ratios": ratios}


def _seconds(anchored: AnchoredItem, model: ObjectModel) -> float:
    problem = anchored.problem
    batch = batch_of_models(
        [model] * COST_ROLLOUTS,
        [problem.controls.part(slice(problem.first_frame, None))] * COST_ROLLOUTS,
        starts=[problem.start] * COST_ROLLOUTS,
        ground_height=anchored.episode.ground_height,
    )
    began = time.process_time()
    rollout(batch)
    return time.process_time() - began


def _model(name: str, anchored: AnchoredItem, trained: Path) -> ObjectModel:
    """What a model of the comparison makes of a coarse fit."""
    if name == COARSE:
        return anchored.model
    if name in LEARNED:
        return with_prior(anchored.model, load_codebook(checkpoint(trained, name)))[0]
    if name == SEARCHED:
        codebook = load_codebook(checkpoint(trained, CODEBOOK))
        problem, shape = prepared(anchored.episode)
        fit = fit_coarse([problem], shape, OPTIONS, seed=SEED, progress=lambda *_: None, codebook=codebook)
        return fit.model
    raise ValueError(f"no model of the comparison is called {name!r}")


def _keep(rows: Path, item: Item, anchored: AnchoredItem, name: str, model: ObjectModel, seconds: float) -> None:
    """Score a model and write its row."""
    began = time.process_time()
    try:
        positions = predict(model, anchored.problem)
    except SimulationError:
        positions = None
    seconds += time.process_time() - began
    scores = None if positions is None else score(positions, model.graph.surface, anchored.episode)
    keep_scores(rows, item, name, scores, seconds, anchor=anchored.anchor)


def keep_scores(rows: Path, item: Item, name: str, scores: Scores | None, seconds: float, *, anchor: str) -> None:
    """Write the row of a model, without errors if it diverged.

    Args:
        anchor: id of the coarse fit that it began with, empty of what needs none.
    """
    values = {} if scores is None else scores.as_dict()
    told = {short: values.get(key, np.nan) for key, short in NAMES.items()}
    finite = {short: value if np.isfinite(value) else None for short, value in told.items()}
    path = _path(rows, item, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    row = {"item": item.name, "model": name, **finite, "seconds": seconds, "anchor": anchor, "commit": commit()}
    write_json(path, row)


def measure_baselines(items: list[Item], rows: Path = ROWS) -> None:
    """Rows of predictions without physics."""
    for item in items:
        if all(_path(rows, item, name).exists() for name in BASELINES):
            continue
        observed = observe_episode(read_episode(item.path))
        for name, scores in baseline_scores(observed.episode, observed.contact).items():
            keep_scores(rows, item, name, scores, 0.0, anchor="")


def _path(rows: Path, item: Item, model: str) -> Path:
    return rows / f"{item.name}.{model.replace(' ', '_')}.json"
