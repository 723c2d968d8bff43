"""What a prior could give at best: coarse fits of held-out sequences, with the true stiffness of every place.

    python -m benchmarks.prior.true_stiffness [--shapes towel mitt ...]

The generator knows how stiff each element of an object is; no prior can know it better. Every spring takes that, over
the object's mean, to the power of a strength, times a level that all springs share. A line a sequence, train and test
TE in mm: of the coarse fit; with the true stiffness as it is; with the strength and level that are best on the train
frames; and with those of the opposite strengths, which say what is gained by choosing alone.
"""

import argparse
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.prior.anchors import OPTIONS, SEED, prepared
from benchmarks.prior.dataset import OPTIONS as OBSERVED
from benchmarks.prior.dataset import rehearse_sequence
from benchmarks.prior.objects import Shape, make_object
from benchmarks.prior.sequences import SEQUENCES, Sequence, Split
from benchmarks.prior.variations import Variation
from egophys_core.errors import SimulationError
from egophys_core.evaluation import score
from egophys_core.geometry import rigid_fit
from egophys_core.identification.building import predict
from egophys_core.identification.coarse import fit_coarse
from egophys_core.observation import FitProblem
from egophys_core.rehearsal.bodies import SoftBody
from egophys_core.twin import ObjectModel

STRENGTHS = (0.5, 1.0)
LEVELS = (0.5, 0.7, 1.0, 1.4, 2.0)

ALONG_SPRING = (0.15, 0.5, 0.85)
"""Places on a spring of which the mean counts."""

NEAREST = 4
"""Elements about a place."""


def log_stiffness(body: SoftBody, lies: np.ndarray, springs: np.ndarray) -> np.ndarray:
    """[E] logarithm of the true stiffness over the object's mean at each spring.

    Args:
        body: the object as it was made.
        lies: [P, 3] metres, its tracked points where it lies; NaN where not seen.
        springs: [E, 2, 3] metres, the ends of its twin's springs there.
    """
    seen = np.isfinite(lies).all(axis=1)
    turn, shift = rigid_fit(body.tracked(body.vertices)[seen], lies[seen].astype(np.float64))
    elements = cKDTree(body.vertices[body.elements].mean(axis=1) @ turn.T + shift)
    places = np.stack([(1.0 - share) * springs[:, 0] + share * springs[:, 1] for share in ALONG_SPRING])
    distances, near = elements.query(places, NEAREST)
    logarithms = np.log(body.stiffness_shares)[near]
    return np.asarray(np.average(logarithms, weights=1.0 / (distances + 1e-3), axis=2).mean(axis=0))


def track_errors(sequence: Sequence) -> list[np.ndarray]:
    """[2] train and test TE in metres of the coarse fit and of the three others, as above."""
    episode = rehearse_sequence(sequence)
    problem, shape = prepared(episode)
    coarse = fit_coarse([problem], shape, OPTIONS, seed=SEED, progress=lambda share, loss: None).model
    body = make_object(sequence.shape, sequence.variation, sequence.object_seed, points=OBSERVED.points)
    lies = np.full((OBSERVED.points, 3), np.nan)
    lies[episode.point_ids] = episode.points[0]
    true = log_stiffness(body, lies, problem.start[coarse.graph.springs].astype(np.float64))

    def with_true(strength: float, level: float) -> np.ndarray:
        stiffness = coarse.stiffness * level * np.exp(strength * true)
        return _track_errors(replace(coarse, stiffness=stiffness.astype(np.float32)), problem)

    levels = [with_true(0.0, level) for level in LEVELS]
    chosen = [
        min(
            [*levels, *(with_true(sign * strength, level) for strength, level in product(STRENGTHS, LEVELS))],
            key=_train,
        )
        for sign in (1.0, -1.0)
    ]
    return [levels[LEVELS.index(1.0)], with_true(1.0, 1.0), *chosen]


def _train(errors: np.ndarray) -> float:
    return float(errors[0])


def _track_errors(model: ObjectModel, problem: FitProblem) -> np.ndarray:
    """[2] metres; infinite where it diverges."""
    try:
        scores = score(predict(model, problem), model.graph.surface, problem.episode)
    except SimulationError:
        return np.full(2, np.inf)
    return np.array([scores.train_track_m, scores.test_track_m])


def main() -> None:
    """Print a line a sequence, then geometric means of the ratios to the coarse fit."""
    parser = argparse.ArgumentParser(description="what a stiffness prior could give at best")
    parser.add_argument("--shapes", nargs="+", type=Shape, choices=list(Shape), default=list(Shape))
    shapes, found = parser.parse_args().shapes, []
    print("train, test TE (mm): coarse fit | true stiffness | strength and level chosen | of opposite strengths")
    for sequence in SEQUENCES:
        if (
            sequence.split is Split.HELD_OUT
            and sequence.shape in shapes
            and sequence.variation is not Variation.UNIFORM
        ):
            found.append(track_errors(sequence))
            shown = " | ".join(f"{1e3 * train:5.1f} {1e3 * test:5.1f}" for train, test in found[-1])
            print(f"{sequence.name:34s} {sequence.variation:10s} {shown}", flush=True)
    ratios = np.exp(np.log(np.array(found) / np.array(found)[:, :1]).mean(axis=0))
    print(f"over the coarse fit, {len(found)}: " + " | ".join(f"{train:.3f} {test:.3f}" for train, test in ratios))


if __name__ == "__main__":
    main()
