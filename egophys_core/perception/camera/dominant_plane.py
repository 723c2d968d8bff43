"""The dominant plane of a scene followed through a video: which points of a keyframe are where in each frame.

Images of a plane by a pinhole camera are related by homographies (Hartley and Zisserman 2004, 13.1). What does not move
with the plane that fills most of the view (the hand, the object, what is higher) does not fit them and drops out.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.camera.plane_keyframe import (
    FEWEST_POINTS,
    Keyframe,
    PlaneFit,
    fit_plane,
    is_near,
    plane_homography,
    share_inside,
    spread_corners,
)
from egophys_core.perception.surface.patch_match import even_contrast

KEPT_KEYFRAMES = 24
"""Keyframes whose image is kept, the last used: bounds the memory."""

_COARSE_LEVELS = 3
_LINK_ABOVE = 0.35
_DARK = 5.0
_FEATURES = 1500
_RECOGNISED_PX = 3.0
_SEARCHED_KEYFRAMES = 6
_LONGEST_WAIT = 8
"""Frames between two searches by features."""
_RESTART_BELOW = 5
"""Frames tied to the first keyframe before it is trusted more than a frame that does not fit it."""

HIDDEN = "too little of the table found (hidden, blurred, out of view or without texture)"
BLACK = "the image is black"


@dataclass(frozen=True, kw_only=True)
class PlaneObservation:
    """Points of a keyframe that lie on the plane, seen in another frame."""

    frame: int
    keyframe: int
    """The frame that is the keyframe."""
    points: np.ndarray
    """[N] int, of the keyframe's points."""
    pixels: np.ndarray
    """[N, 2] float32, x and y in the frame."""


class PlaneTracker:
    """Follows the dominant plane through frames of one size; the same frames give the same observations.

    Attributes:
        keyframes: by frame, the first first; images of those long unused are dropped.
        observations: in order of the frames, one of most frames, two or three where keyframes are linked.
        from_first: by frame, [3, 3] homography to it from the pixels of the first keyframe.
        lost: by frame, why it could not be tied to a keyframe.
    """

    def __init__(self) -> None:
        self.keyframes: dict[int, Keyframe] = {}
        self.observations: list[PlaneObservation] = []
        self.from_first: dict[int, np.ndarray] = {}
        self.lost: dict[int, str] = {}
        self._used: list[int] = []
        """Keyframes with images, the last used last."""
        self._last = np.eye(3)
        """Last homography found, from the pixels of the first keyframe."""
        self._previous: tuple[int, np.ndarray, np.ndarray] | None = None
        """The frame before, its image and that of even contrast, if it was tied."""
        self._missed = 0
        """Frames since the last that was tied."""
        self._sift = cv2.SIFT.create(nfeatures=_FEATURES)
        self._matcher = cv2.BFMatcher(cv2.NORM_L2)

    def add(self, frame: int, image: np.ndarray, expected: np.ndarray | None = None) -> bool:
        """Tie a frame to the keyframes; whether that worked.

        Args:
            frame: its number, larger than those before.
            image: [H, W, 3] uint8 BGR, pinhole.
            expected: [3, 3] homography to it from the pixels of the first keyframe, if it is nearly known; the frame is
                then not searched for by features.
        """
        if image.mean() < _DARK:
            self.lost[frame] = BLACK
            return False
        grey = even_contrast(image)
        if not self.keyframes:
            return self._start(frame, image, grey)
        key = self.keyframes[self._used[-1]]
        to_first = np.linalg.inv(key.from_first)
        fit = None if expected is None else self._follow(key, grey, expected @ to_first)
        fit = fit or self._follow(key, grey, self._last @ to_first)
        if fit is None and self._previous is not None:
            # The look of the table has changed too much since the keyframe, by slant or light, but not since then.
            key = self._recall(*self._previous)
            fit = self._follow(key, grey, np.eye(3))
        self._previous = None
        if fit is None:
            found = self._find_again(grey) if expected is None and self._is_time_to_search() else None
            if found is None:
                self._missed += 1
                if len(self.from_first) <= _RESTART_BELOW:
                    return self._start(frame, image, grey)
                self.lost[frame] = HIDDEN
                return False
            key, fit = found
        self._keep(frame, key, fit)
        self._previous = (frame, image, grey)
        if not is_near(key, fit, grey.shape):
            self._change_keyframe(frame, image, grey, key)
        return True

    def _start(self, frame: int, image: np.ndarray, grey: np.ndarray) -> bool:
        """Take a frame for the first keyframe, and those before it for lost."""
        self.lost.update(dict.fromkeys(self.from_first, HIDDEN))
        self.keyframes, self.observations, self.from_first, self._used = {}, [], {}, []
        key = self._keyframe(frame, image, grey, np.eye(3))
        if len(key.points) < FEWEST_POINTS:
            self.lost[frame] = HIDDEN
            return False
        self._last = np.eye(3)
        self._previous = None
        self.from_first[frame] = self._last
        self._use(key)
        return True

    def _keep(self, frame: int, key: Keyframe, fit: PlaneFit) -> None:
        self._missed = 0
        key.tracked[fit.tracked] += 1
        key.on_plane[fit.points] += 1
        key.best_share = max(key.best_share, fit.share)
        self.observations.append(
            PlaneObservation(frame=frame, keyframe=key.frame, points=fit.points, pixels=fit.pixels)
        )
        self._last = fit.homography @ key.from_first
        self.from_first[frame] = self._last
        self._use(key)

    def _use(self, key: Keyframe) -> None:
        self.keyframes[key.frame] = key
        self._used = [each for each in self._used if each != key.frame] + [key.frame]
        for old in self._used[:-KEPT_KEYFRAMES]:
            dropped = self.keyframes[old]
            dropped.grey, dropped.features = np.zeros((0, 0), np.uint8), None
        self._used = self._used[-KEPT_KEYFRAMES:]

    def _change_keyframe(self, frame: int, image: np.ndarray, grey: np.ndarray, key: Keyframe) -> None:
        """Go over to a keyframe seen more fully, of those there are or this frame, and link it with the others."""
        here = self._last
        others = [self.keyframes[each] for each in self._used if each != key.frame]
        shares = [share_inside(each.points, here @ np.linalg.inv(each.from_first), grey.shape) for each in others]
        linked = False
        for index in np.argsort(shares)[::-1][:2]:
            if shares[index] < _LINK_ABOVE:
                break
            fit = self._follow(others[index], grey, here @ np.linalg.inv(others[index].from_first))
            if fit is None:
                continue
            self._keep(frame, others[index], fit)
            if is_near(others[index], fit, grey.shape):
                linked = True
                break
        if not linked:
            new = self._keyframe(frame, image, grey, self._last)
            self._use(new if len(new.points) >= FEWEST_POINTS else key)

    def _follow(self, key: Keyframe, grey: np.ndarray, guess: np.ndarray) -> PlaneFit | None:
        """Fit from a homography that is nearly right: coarsely first, then with what that leaves."""
        coarse = fit_plane(key, grey, guess, _COARSE_LEVELS)
        return None if coarse is None else fit_plane(key, grey, coarse.homography, 1)

    def _find_again(self, grey: np.ndarray) -> tuple[Keyframe, PlaneFit] | None:
        """Fit to any keyframe by features that are recognised."""
        places, descriptors = self._features(grey)
        if len(places) < FEWEST_POINTS:
            return None
        for frame in self._used[: -_SEARCHED_KEYFRAMES - 1 : -1]:
            key = self.keyframes[frame]
            key.features = key.features or self._features(key.grey)
            their_places, their_descriptors = key.features
            pairs = self._matcher.knnMatch(descriptors, their_descriptors, k=2) if len(their_places) > 1 else []
            good = [(near.queryIdx, near.trainIdx) for near, far in pairs if near.distance < 0.8 * far.distance]
            if len(good) < FEWEST_POINTS // 2:
                continue
            here, there = np.array(good).T
            guess, held = plane_homography(their_places[there], places[here], _RECOGNISED_PX)
            if guess is None or held.sum() < FEWEST_POINTS // 2:
                continue
            fit = self._follow(key, grey, guess)
            if fit is not None:
                return key, fit
        return None

    def _is_time_to_search(self) -> bool:
        """Whether to look for features, which takes ten times longer: ever more rarely while that finds nothing."""
        return self._missed & (self._missed + 1) == 0 or self._missed % _LONGEST_WAIT == 0

    def _recall(self, frame: int, image: np.ndarray, grey: np.ndarray) -> Keyframe:
        """The keyframe made of a frame that is tied."""
        return self.keyframes.get(frame) or self._keyframe(frame, image, grey, self.from_first[frame])

    def _keyframe(self, frame: int, image: np.ndarray, grey: np.ndarray, from_first: np.ndarray) -> Keyframe:
        points = spread_corners(image)
        return Keyframe(
            frame=frame,
            points=points,
            from_first=from_first,
            tracked=np.zeros(len(points), int),
            on_plane=np.zeros(len(points), int),
            grey=grey,
        )

    def _features(self, grey: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        features, descriptors = self._sift.detectAndCompute(grey, None)
        if descriptors is None:
            return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)
        return np.array([each.pt for each in features], np.float32), descriptors
