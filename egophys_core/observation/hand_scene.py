"""HandScene: what one hand does, frame by frame, and what the object points near it do meanwhile."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.episode import Episode

NEAR_HAND = 0.04
"""Metres: object points this near to one of a hand's points tell whether the object moves with the hand."""

STEP = 0.01
"""Metres of hand travel over which is asked whether points came along; several times the noise of their mean."""

LONGEST_STEP_S = 0.5
"""A hand that needs longer than this for a step stands still, and then nothing tells whether points come along."""

SPEED_WINDOW_S = 0.07
"""Time over which speeds are taken; the mean of ten points of 1.5 mm noise then has a noise of 0.015 m/s."""

LARGEST_DELAY_S = 0.2
"""Object points that lag more than this behind the hand are not late but slow."""

DELAY_GAIN = 0.8
"""Points count as late if, moved earlier, their residuals to the hand's motion are less than this share of before."""


@dataclass(frozen=True, kw_only=True)
class Along:
    """How points moved while the hand made a step."""

    share: float
    """-1 (stayed or went against it) .. 1 (came along in full); 0 for half of the step."""
    rigidly: bool
    """Whether they also kept their distance to the hand, to half of the step."""
    ahead: float
    """-1 (behind the hand) .. 1 (in front of it): mean cosine between the step and the directions to them."""


@dataclass(frozen=True, kw_only=True)
class HandScene:
    """One hand and the object in T frames; object points are moved earlier if they are recorded late."""

    times: np.ndarray
    """[T] seconds."""
    hand: np.ndarray
    """[T, 3] metres, mean of the hand's controller points."""
    points: np.ndarray
    """[T, N, 3] metres, NaN where not seen."""
    last_seen: np.ndarray
    """[T, N, 3] metres: where a point is or, if it is not seen, was last; NaN before it is first seen."""
    near: np.ndarray
    """[T, N] bool: seen, and within `NEAR_HAND` of one of the hand's points."""
    gap: np.ndarray
    """[T] metres: mean distance of the hand's points to the nearest object point seen; as before if none is."""
    step: np.ndarray
    """[T, 2] frames around each in which the hand moves by `STEP`; farther apart where it is slower."""
    travel: np.ndarray
    """[T] metres that the hand moves in one frame, from its step; 0 where it stands still."""
    seconds: np.ndarray
    """[T] seconds that one frame stands for."""
    speed_window: np.ndarray
    """[T, 2] frames `SPEED_WINDOW_S` apart around each."""

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.times)

    def near_around(self, frame: int) -> np.ndarray:
        """[N] bool: points near the hand when the step around a frame begins or ends."""
        before, after = self.step[frame]
        return self.near[before] | self.near[after]

    def along(self, frame: int, points: np.ndarray) -> Along | None:
        """How `points` [N] bool moved in the step around a frame; None if that is not seen or the hand stands still."""
        before, after = self.step[frame]
        seen = self._seen(points, before, after)
        if self.travel[frame] == 0 or not seen.any():
            return None
        step = self.hand[after] - self.hand[before]
        length = np.linalg.norm(step)
        moved = (self.points[after, seen] - self.points[before, seen]).mean(axis=0)
        towards = self.points[before, seen] - self.hand[before]
        towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
        return Along(
            share=float(np.clip(2 * (moved @ step) / length**2 - 1, -1, 1)),
            rigidly=bool(np.linalg.norm(moved - step) < 0.5 * length),
            ahead=float(towards.mean(axis=0) @ step / length),
        )

    def speeds(self, frame: int, points: np.ndarray) -> tuple[float, float | None]:
        """m/s: speed of the hand, and against the mean of `points` [N] bool; None if none of them is seen."""
        before, after = self.speed_window[frame]
        duration = self.times[after] - self.times[before]
        step = self.hand[after] - self.hand[before]
        seen = self._seen(points, before, after)
        if not seen.any():
            return float(np.linalg.norm(step) / duration), None
        moved = (self.points[after, seen] - self.points[before, seen]).mean(axis=0)
        return float(np.linalg.norm(step) / duration), float(np.linalg.norm(moved - step) / duration)

    def drift(self, one: int, other: int, points: np.ndarray) -> float:
        """Metres between the mean places of `points` [N] bool, as last seen, against the hand in two frames."""
        moved = self.last_seen[other, points] - self.last_seen[one, points]
        moved = moved[np.isfinite(moved).all(axis=1)]
        step = self.hand[other] - self.hand[one]
        return float(np.linalg.norm(moved.mean(axis=0) - step)) if len(moved) else float(np.linalg.norm(step))

    def _seen(self, points: np.ndarray, before: int, after: int) -> np.ndarray:
        return points & np.isfinite(self.points[[before, after]]).all(axis=(0, 2))


def look_at_hand(episode: Episode, members: np.ndarray, *, delay: int = 0) -> HandScene:
    """The scene of the hand with the controllers `members` [H].

    Args:
        delay: frames by which the object points are recorded late; they are moved earlier by so many.
    """
    times = episode.times
    fingers = episode.controllers[:, members].astype(np.float64)
    hand = fingers.mean(axis=1)
    points = np.full(episode.points.shape, np.nan)
    points[: len(points) - delay] = episode.points[delay:]
    last_seen, near, gap = _nearness(fingers, points)
    step = _steps(times, hand)
    length = np.linalg.norm(hand[step[:, 1]] - hand[step[:, 0]], axis=1)
    seconds = np.gradient(times)
    return HandScene(
        times=times,
        hand=hand,
        points=points,
        last_seen=last_seen,
        near=near,
        gap=gap,
        step=step,
        travel=np.where(length < STEP, 0.0, length * seconds / (times[step[:, 1]] - times[step[:, 0]])),
        seconds=seconds,
        speed_window=_windows(len(times), max(1, round(SPEED_WINDOW_S / 2 / float(np.median(seconds))))),
    )


def observed_delay(scenes: Sequence[HandScene], holding: Sequence[np.ndarray]) -> int:
    """Frames by which the object points lag behind the hands that hold them; 0 where they do not.

    Hands and points may be recorded with different delays; at 0.3 m/s 0.1 s makes 3 cm, which looks like
    letting go.

    Args:
        holding: for each scene [T] bool, frames in which that hand seems to hold. A press does not tell: an object
            that follows late has not been told from one that is touched late.
    """
    if not scenes:
        return 0
    longest = round(LARGEST_DELAY_S / float(np.median(scenes[0].seconds)))
    pairs = zip(scenes, holding, strict=True)
    residuals = np.sum([_delay_residuals(scene, np.flatnonzero(frames), longest) for scene, frames in pairs], axis=0)
    best = int(np.argmin(residuals))
    return best if residuals[best] < DELAY_GAIN * residuals[0] else 0


def _delay_residuals(scene: HandScene, frames: np.ndarray, longest: int) -> np.ndarray:
    """[longest + 1] metres: residuals of points near a hand to its motion, were they recorded so many frames late."""
    late = np.arange(longest + 1)
    residuals = np.zeros(longest + 1)
    for frame in frames[scene.travel[frames] > 0]:
        before, after = scene.step[frame]
        if after + longest >= scene.frames:
            break
        moved = (scene.points[after + late] - scene.points[before + late])[:, scene.near_around(frame)]
        seen = np.isfinite(moved).all(axis=2)
        if seen.any(axis=1).all():
            step = scene.hand[after] - scene.hand[before]
            error = np.array([each[here].mean(axis=0) for each, here in zip(moved, seen, strict=True)]) - step
            residuals += scene.travel[frame] * np.linalg.norm(error, axis=1) / np.linalg.norm(step)
    return residuals


def _nearness(fingers: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`last_seen`, `near` and `gap` of a scene, from fingers [T, H, 3] and points [T, N, 3] in metres."""
    seen = np.isfinite(points).all(axis=2)
    last_seen, near, gap = points.copy(), np.zeros(seen.shape, bool), np.full(len(points), np.inf)
    for frame, (hand, visible) in enumerate(zip(fingers, seen, strict=True)):
        if frame:
            last_seen[frame, ~visible] = last_seen[frame - 1, ~visible]
            gap[frame] = gap[frame - 1]
        if visible.any():
            near[frame, visible] = cKDTree(hand).query(points[frame, visible])[0] < NEAR_HAND
            gap[frame] = cKDTree(points[frame, visible]).query(hand)[0].mean()
    return last_seen, near, gap


def _steps(times: np.ndarray, hand: np.ndarray) -> np.ndarray:
    """`step` of a scene: the shortest window around each frame in which the hand moves by `STEP`."""
    step = _windows(len(times), 1)
    for half in range(2, round(LONGEST_STEP_S / 2 / float(np.median(np.diff(times)))) + 1):
        short = np.linalg.norm(hand[step[:, 1]] - hand[step[:, 0]], axis=1) < STEP
        step[short] = _windows(len(times), half)[short]
    return step


def _windows(frames: int, half: int) -> np.ndarray:
    """[T, 2] frames `half` before and after each, within the recording."""
    frame = np.arange(frames)
    return np.stack([np.maximum(frame - half, 0), np.minimum(frame + half, frames - 1)], axis=1)
