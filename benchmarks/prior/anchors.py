"""The coarse fit of every sequence, which all models of the comparison begin with, and dense refinement of it.

Files are kept: a measurement that was stopped goes on where it was.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.prior.dataset import FOLDER
from benchmarks.prior.items import Item, all_items
from benchmarks.prior.sequences import Split
from benchmarks.side_by_side import side_by_side
from egophys_core import __version__
from egophys_core.episode import Episode
from egophys_core.files import write_json
from egophys_core.identification import FitOptions
from egophys_core.identification.building import episode_digest
from egophys_core.identification.coarse import fit_coarse
from egophys_core.identification.dense import DenseRefinement
from egophys_core.identification.surface_fit import first_grasp
from egophys_core.kinds.kind import RestShape
from egophys_core.kinds.rest_shape import rest_shape
from egophys_core.observation import FitProblem, observe_episode, prepare
from egophys_core.observation.grasp_radius import grasp_radius
from egophys_core.recording import read_episode
from egophys_core.twin import ObjectModel, Provenance, Twin, load_twin, save_twin

ANCHORS = FOLDER.parent / "anchors"
OPTIONS = FitOptions(generations=20)
"""The paper takes 50 generations: with these, the set takes an hour instead of two."""

SEED = 0
TEACHER_STEPS = 25
"""Of dense refinement on training sequences, whose stiffness the prior is taught."""


@dataclass(frozen=True, kw_only=True)
class AnchoredItem:
    """An item, ready to be rolled out, and its coarse fit."""

    episode: Episode
    problem: FitProblem
    model: ObjectModel
    seconds: float
    """That the coarse fit took."""


def make_anchors(data: Path, folder: Path, *, workers: int, report: Callable[[str, int, int], None]) -> None:
    """Fit what is missing."""
    missing = [each for each in all_items(data) if _is_missing(each, folder)]
    for done, (item, _) in enumerate(side_by_side(partial(make_anchor, folder=folder), missing, workers=workers), 1):
        report(item.name, done, len(missing))


def make_anchor(item: Item, folder: Path) -> None:
    """Fit one item on its train frames; if it is for training refine it densely, too."""
    episode = read_episode(item.path)
    problem, shape = prepared(episode)
    began = time.process_time()
    if not _path(folder, item, "coarse").exists():
        fit = fit_coarse([problem], shape, OPTIONS, seed=SEED, progress=lambda share, loss: None)
        keep_model(fit.model, episode, problem, folder, item, "coarse", time.process_time() - began)
    if item.split is Split.TRAINING:
        began = time.process_time()
        refinement = DenseRefinement([problem], read_model(folder, item, "coarse"), OPTIONS)
        while len(refinement.history) < TEACHER_STEPS:
            refinement.step()
        keep_model(refinement.best, episode, problem, folder, item, "teacher", time.process_time() - began)


def read_anchored(item: Item, folder: Path) -> AnchoredItem:
    """An item and its coarse fit."""
    episode = read_episode(item.path)
    problem, _ = prepared(episode)
    seconds = json.loads(_path(folder, item, "coarse").with_suffix(".json").read_text())["seconds"]
    return AnchoredItem(episode=episode, problem=problem, model=read_model(folder, item, "coarse"), seconds=seconds)


def keep_model(
    model: ObjectModel,
    episode: Episode,
    problem: FitProblem,
    folder: Path,
    item: Item,
    name: str,
    seconds: float,
) -> None:
    """Write a model of an item, as a twin, and how long it took."""
    path = _path(folder, item, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    provenance = Provenance(
        episodes=({"name": episode.name, "sha256": episode_digest(episode)},),
        settings=OPTIONS.settings(at_markers=False),
        seed=SEED,
        code_version=__version__,
        scores={},
    )
    twin = Twin(model=model, grasp=first_grasp(problem), ground_height=episode.ground_height, provenance=provenance)
    write_json(path.with_suffix(".json"), {"seconds": seconds})
    save_twin(twin, path)


def read_model(folder: Path, item: Item, name: str) -> ObjectModel:
    """A model of an item that was kept."""
    return load_twin(_path(folder, item, name)).model


def stiffness_taught(folder: Path, item: Item) -> np.ndarray:
    """[E] logarithm of the stiffness that dense refinement found over that of the coarse fit."""
    return np.asarray(
        np.log(read_model(folder, item, "teacher").stiffness / read_model(folder, item, "coarse").stiffness)
    )


def prepared(episode: Episode) -> tuple[FitProblem, RestShape]:
    """As a build prepares it (`identification.surface_fit`)."""
    observed = observe_episode(episode)
    shape = rest_shape(observed.at_rest, name=episode.name, ground=episode.ground_height, max_nodes=OPTIONS.max_nodes)
    shape = replace(shape, grasp_radius=grasp_radius([observed]), lies=not observed.hangs)
    return prepare(observed, shape.positions, shape.surface, spacing=shape.spacing), shape


def _path(folder: Path, item: Item, name: str) -> Path:
    return folder / f"{item.name}.{name}.twin"


def _is_missing(item: Item, folder: Path) -> bool:
    names = ("coarse", "teacher") if item.split is Split.TRAINING else ("coarse",)
    return not all(_path(folder, item, name).exists() for name in names)
