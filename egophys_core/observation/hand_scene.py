"""HandScene: what one hand does, frame by frame, and what the object points near it do meanwhile."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial import cKDTree

from egophys_core.episode import Episode
from egophys_core.interpolation import tracks_at

NEAR_HAND = 0.04
"""Metres: object points this near to one of a hand's points tell whether the object moves with the hand."""

STEP, STEP_NOISES = 0.01, 3.0
"""Metres of hand travel, at least, over which is asked whether points came along, and over the noise of their mean."""

PATIENCE_S, PATIENCE_FRAMES = 0.1, 5
"""Noise and hidden points may make a hand that stays look as if it moved away, but not for longer than these."""

LONGEST_STEP_S = 0.5
"""A hand that needs longer than this for a step stands still, and then nothing tells whether points come along."""

RISES = 0.7
"""Of a step, upwards, from which the hand rises."""

STILL = 0.04
"""m/s: the least that counts as motion of a hand against points."""

SPEED_WINDOW_S = 0.07
"""Time over which speeds are taken; the mean of ten points of 1.5 mm noise then has a noise of 0.015 m/s."""


@dataclass(frozen=True, kw_only=True)
class Along:
    """How points moved while the hand made a step."""

    share: float
    """-1 (stayed or went against it) .. 1 (came along in full); 0 for half of the step."""
    rigidly: bool
    """Whether they also kept their distance to the hand, to half of the step."""
    ahead: float
    """-1 (behind the hand) .. 1 (in front of it): mean cosine between the step and the directions to them; -1 where the
    hand rises with them: what is above the middle of a hand that has sunk in is lifted by it, not pushed."""


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
    noise: float
    """Metres, of the mean of points near the hand between two frames."""
    step: np.ndarray
    """[T, 2] frames around each in which the hand moves by `step_m`; farther apart where it is slower."""
    travel: np.ndarray
    """[T] metres that the hand moves in one frame, from its step; 0 where it stands still."""
    seconds: np.ndarray
    """[T] seconds that one frame stands for."""
    speed_window: np.ndarray
    """[T, 2] frames `SPEED_WINDOW_S` apart around each."""

    @property
    def step_m(self) -> float:
        """Metres of hand travel over which is asked whether points came along."""
        return step_length(self.noise)

    @property
    def still(self) -> float:
        """m/s: a hand that moves no faster than this against the points near it has arrived, or slips."""
        return max(STILL, self.noise / SPEED_WINDOW_S)

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
        rises = step[2] > RISES * length
        towards = self.points[before, seen] - self.hand[before]
        towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
        return Along(
            share=float(np.clip(2 * (moved @ step) / length**2 - 1, -1, 1)),
            rigidly=bool(np.linalg.norm(moved - step) < 0.5 * length),
            ahead=-1.0 if rises else float(towards.mean(axis=0) @ step / length),
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

    def drifts(self, points: np.ndarray, since: int) -> np.ndarray:
        """[T, 3] metres: how the mean of `points` [N] bool, as last seen, has moved against the hand since a frame.

        It is the median over `patience`: single frames may be stamped wrongly, or have wrong points.
        """
        moved = self.last_seen[:, points] - self.last_seen[since, points]
        known = np.isfinite(moved).all(axis=2)
        mean = np.where(known[..., None], moved, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)[:, None]
        frames = 2 * int(self.patience / 2 / float(np.median(self.seconds))) + 1
        return np.asarray(median_filter(mean - (self.hand - self.hand[since]), size=(frames, 1), mode="nearest"))

    @property
    def patience(self) -> float:
        """Seconds for which noise and hidden points may make a hand that stays look as if it moved away."""
        return max(PATIENCE_S, PATIENCE_FRAMES * float(np.median(self.seconds)))

    def _seen(self, points: np.ndarray, before: int, after: int) -> np.ndarray:
        return points & np.isfinite(self.points[[before, after]]).all(axis=(0, 2))


def look_at_hand(episode: Episode, members: np.ndarray, *, delay: float = 0.0, noise: float = 0.0) -> HandScene:
    """The scene of the hand with the controllers `members` [H].

    Args:
        delay: seconds by which the object points are recorded late; they are moved earlier by that.
        noise: metres, of the mean of points near the hand between two frames.
    """
    times = episode.times
    fingers = episode.controllers[:, members].astype(np.float64)
    hand = fingers.mean(axis=1)
    points = episode.points.astype(np.float64)
    if delay:
        points = tracks_at(times, points, times + delay)
    last_seen, near, gap = _nearness(fingers, points)
    step_m = step_length(noise)
    step = steps_of(times, hand, step_m)
    length = np.linalg.norm(hand[step[:, 1]] - hand[step[:, 0]], axis=1)
    seconds = np.gradient(times)
    return HandScene(
        times=times,
        hand=hand,
        points=points,
        last_seen=last_seen,
        near=near,
        gap=gap,
        noise=noise,
        step=step,
        travel=np.where(length < step_m, 0.0, length * seconds / (times[step[:, 1]] - times[step[:, 0]])),
        seconds=seconds,
        speed_window=_windows(len(times), max(1, round(SPEED_WINDOW_S / 2 / float(np.median(seconds))))),
    )


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


def step_length(noise: float) -> float:
    """Metres that a hand moves in a step, for points of so much noise in metres."""
    return max(STEP, STEP_NOISES * noise)


def steps_of(times: np.ndarray, hand: np.ndarray, step_m: float = STEP) -> np.ndarray:
    """[T, 2]: the shortest window of frames around each in which a hand at [T, 3] metres moves by so much."""
    step = _windows(len(times), 1)
    for half in range(2, round(LONGEST_STEP_S / 2 / float(np.median(np.diff(times)))) + 1):
        short = np.linalg.norm(hand[step[:, 1]] - hand[step[:, 0]], axis=1) < step_m
        step[short] = _windows(len(times), half)[short]
    return step


def _windows(frames: int, half: int) -> np.ndarray:
    """[T, 2] frames `half` before and after each, within the recording."""
    frame = np.arange(frames)
    return np.stack([np.maximum(frame - half, 0), np.minimum(frame + half, frames - 1)], axis=1)
