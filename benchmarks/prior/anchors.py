"""The coarse fit of every sequence, which all models of the comparison begin with, and dense refinement of it.

Files are kept: a measurement that was stopped goes on where it was.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.prior.dataset import FOLDER
from benchmarks.prior.items import Item, all_items
from benchmarks.prior.sequences import Split
from benchmarks.side_by_side import side_by_side
from egophys_core import __version__
from egophys_core.episode import Episode
from egophys_core.identification import FitOptions
from egophys_core.identification.building import episode_digest
from egophys_core.identification.coarse import fit_coarse
from egophys_core.identification.dense import fit_dense
from egophys_core.identification.surface_fit import first_grasp, shape_to_search
from egophys_core.kinds.kind import RestShape
from egophys_core.observation import FitProblem, observe_episode, prepare
from egophys_core.recording import read_episode
from egophys_core.twin import ObjectModel, Provenance, Twin, load_twin, save_twin

ANCHORS = FOLDER.parent / "anchors"
OPTIONS = FitOptions(generations=20)
"""The paper takes 50 generations: with these, the set takes an hour instead of two."""

SEED = 0


@dataclass(frozen=True, kw_only=True)
class AnchoredItem:
    """An item, ready to be rolled out, and its coarse fit."""

    episode: Episode
    problem: FitProblem
    model: ObjectModel
    anchor: str
    """Id of the coarse fit."""


def make_anchors(data: Path, folder: Path, *, workers: int, report: Callable[[str, int, int], None]) -> None:
    """Fit what is missing."""
    missing = [each for each in all_items(data) if _is_missing(each, folder)]
    for done, (item, _) in enumerate(side_by_side(partial(make_anchor, folder=folder), missing, workers=workers), 1):
        report(item.name, done, len(missing))


def make_anchor(item: Item, folder: Path) -> None:
    """Fit one item on its train frames; if it is for training refine it densely, too."""
    episode = read_episode(item.path)
    problem, shape = prepared(episode)
    if not is_anchored(item, folder):
        fit = fit_coarse([problem], shape, OPTIONS, seed=SEED, progress=lambda share, loss: None)
        keep_model(fit.model, problem, folder, item, "coarse")
    if item.split is Split.TRAINING:
        coarse = read_model(folder, item, "coarse")
        taught = fit_dense([problem], coarse, OPTIONS, progress=lambda share, loss: None)
        keep_model(taught, problem, folder, item, "teacher")


def read_anchored(item: Item, folder: Path) -> AnchoredItem:
    """An item and its coarse fit."""
    episode = read_episode(item.path)
    problem, _ = prepared(episode)
    twin = load_twin(_path(folder, item, "coarse"))
    return AnchoredItem(episode=episode, problem=problem, model=twin.model, anchor=twin.twin_id)


def anchor_id(item: Item, folder: Path) -> str:
    """Id of the coarse fit of an item; its episode is not read for it."""
    return load_twin(_path(folder, item, "coarse")).twin_id


def is_anchored(item: Item, folder: Path) -> bool:
    """Whether an item has its coarse fit."""
    return _path(folder, item, "coarse").exists()


def keep_model(model: ObjectModel, problem: FitProblem, folder: Path, item: Item, name: str) -> None:
    """Write a model of an item, as a twin."""
    path, episode = _path(folder, item, name), problem.episode
    path.parent.mkdir(parents=True, exist_ok=True)
    provenance = Provenance(
        episodes=({"name": episode.name, "sha256": episode_digest(episode)},),
        settings=OPTIONS.settings(at_markers=False),
        seed=SEED,
        code_version=__version__,
        scores={},
    )
    twin = Twin(model=model, grasp=first_grasp(problem), ground_height=episode.ground_height, provenance=provenance)
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
    """As a build prepares it."""
    observed = observe_episode(episode)
    shape = shape_to_search([observed], OPTIONS)
    return prepare(observed, shape.positions, shape.surface, spacing=shape.spacing), shape


def _path(folder: Path, item: Item, name: str) -> Path:
    return folder / f"{item.name}.{name}.twin"


def _is_missing(item: Item, folder: Path) -> bool:
    names = ("coarse", "teacher") if item.split is Split.TRAINING else ("coarse",)
    return not all(_path(folder, item, name).exists() for name in names)
