"""What a twin must beat: predictions without physics."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.episode import Episode
from egophys_core.evaluation.metrics import track_error_per_frame
from egophys_core.evaluation.scores import Scores, score
from egophys_core.interpolation import values_at

LARGEST_LAG_S, LAG_STEP_S = 1.0, 0.1
"""Seconds: by how much hands and points may be recorded apart, and the steps of a first search."""


BASELINES = ("last observed shape stays", "moves with nearest controller", "nearest controller at its best lag")
"""Names of the predictions without physics."""


def baseline_scores(episode: Episode, contact: np.ndarray) -> dict[str, Scores]:
    """Errors of the predictions, by name; train errors of the first are blank, as it copies those frames.

    Args:
        contact: [T, C], not 0 where a controller point holds or presses the object.
    """
    predictions = (
        static_prediction(episode),
        rigid_follow_prediction(episode, contact),
        lagging_prediction(episode, contact),
    )
    scores = {}
    for name, prediction in zip(BASELINES, predictions, strict=True):
        seen = np.isfinite(prediction[0]).all(axis=1)
        scores[name] = score(prediction, seen, episode)
    copied = BASELINES[0]
    blank = {name: float("nan") for name in scores[copied].as_dict() if not name.startswith("test_")}
    scores[copied] = replace(scores[copied], **blank)
    return scores


def static_prediction(episode: Episode) -> np.ndarray:
    """[T, N, 3] metres: the observed points, and after the train frames the last observed shape stays.

    A point that is not seen in a train frame, or was not when the train frames ended, is where it was last
    seen; one not seen until then is NaN.
    """
    prediction = episode.points.copy()
    for frame in range(1, episode.frames):
        source = prediction[frame] if frame < episode.train_frames else np.full_like(prediction[frame], np.nan)
        prediction[frame] = np.where(np.isfinite(source), source, prediction[frame - 1])
    return prediction


def lagging_prediction(episode: Episode, contact: np.ndarray) -> np.ndarray:
    """[T, N, 3] metres: as `rigid_follow_prediction`, by hands so much earlier or later as fits the train frames best.

    Args:
        contact: as there.
    """
    train, bound = slice(1, episode.train_frames), np.arange(episode.points.shape[1])

    def prediction(lag: float) -> np.ndarray:
        at = episode.times - lag
        nearest = np.rint(np.interp(at, episode.times, np.arange(episode.frames))).astype(int)
        moved = replace(episode, controllers=values_at(episode.times, episode.controllers, at))
        return rigid_follow_prediction(moved, contact[nearest])

    def missed(lag: float) -> float:
        errors = track_error_per_frame(prediction(lag)[train], episode.points[train], bound)
        return float(np.nanmean(errors)) if np.isfinite(errors).any() else np.inf

    coarse = min(np.arange(-LARGEST_LAG_S, LARGEST_LAG_S + LAG_STEP_S / 2, LAG_STEP_S), key=missed)
    return prediction(min(coarse + LAG_STEP_S * np.linspace(-1.0, 1.0, 11), key=missed))


def rigid_follow_prediction(episode: Episode, contact: np.ndarray) -> np.ndarray:
    """[T, N, 3] metres: every point of frame 0 moves with the controller nearest to it among those that touch.

    Args:
        contact: [T, C], not 0 where a controller point holds or presses the object. A point moves by its
            controller's displacement since that contact began and stays when it ends.
    """
    hold = contact != 0
    prediction = np.repeat(episode.points[:1], episode.frames, axis=0)
    holding = np.flatnonzero(hold.any(axis=0))
    seen = np.flatnonzero(np.isfinite(episode.points[0]).all(axis=1))
    if len(holding) == 0:
        return prediction
    first = hold[:, holding].argmax(axis=0)
    grasp = episode.controllers[first, holding]
    leader = cKDTree(grasp).query(episode.points[0, seen])[1]
    steps = np.diff(episode.controllers[:, holding], axis=0, prepend=episode.controllers[:1, holding])
    steps[~hold[:, holding]] = 0.0
    # The step into the first held frame still belongs to the reach.
    steps[first, np.arange(len(holding))] = 0.0
    prediction[:, seen] += np.cumsum(steps, axis=0)[:, leader]
    return prediction
