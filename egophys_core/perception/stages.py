"""What the stages of perception hand to each other, and the interface of each stage that can be replaced."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True, kw_only=True)
class View:
    """One frame as every later stage sees it: a square pinhole image, upright, with its pose."""

    stamp_ns: int
    """Nanoseconds since the epoch."""
    image: np.ndarray
    """[S, S, 3] uint8, BGR."""
    camera_matrix: np.ndarray
    """[3, 3] float64, pixels; pixel centres at integer coordinates."""
    world_from_camera: np.ndarray
    """[4, 4] float64, metres; camera x right, y down, z forward. NaN where the pose is not known."""


@dataclass(frozen=True, kw_only=True)
class Masks:
    """Which pixels of a view show the object and the hand (or another manipulator); none shows both."""

    object: np.ndarray
    """[S, S] bool."""
    hand: np.ndarray
    """[S, S] bool."""


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """Places of N queries over T views."""

    pixels: np.ndarray
    """[T, N, 2] float32, x and y in pixels; NaN where unknown."""
    visible: np.ndarray
    """[T, N] bool; where True the pixels are finite."""


@dataclass(frozen=True, kw_only=True)
class PointMap:
    """The surface point that each pixel of a view shows."""

    points: np.ndarray
    """[S, S, 3] float32, metres, frame world; NaN where unknown."""
    confidence: np.ndarray
    """[S, S] float32 in 0..1; 0 where unknown."""


@dataclass(frozen=True, kw_only=True)
class HandLandmarks:
    """One hand in a view: wrist, then base, two joints and tip of the thumb and of each finger, index to little.

    Where nothing is known of a landmark it is NaN.
    """

    pixels: np.ndarray
    """[21, 2] float64, x and y."""
    metric: np.ndarray
    """[21, 3] float64, metres from near the hand's middle; the axes (x right, y down, z away) are those of a camera
    that looks straight at the hand, upright as the view."""
    right: float
    """0..1: how likely it is a right hand."""
    score: float
    """0..1: how likely it is a hand."""


class HandLandmarker(Protocol):
    """A view -> the landmarks of its hands."""

    def hands(self, view: View) -> list[HandLandmarks]:
        """The hands that are found, none twice; the pose of the view is not used."""


class Segmenter(Protocol):
    """Views -> masks, one each, in order, without keeping the views."""

    def masks(self, views: Iterable[View]) -> Iterator[Masks]:
        """Masks of each view."""


class Tracker(Protocol):
    """Views and queries in the first -> tracks."""

    def tracks(self, views: Iterable[View], queries: np.ndarray) -> Tracks:
        """Tracks of queries [N, 2], pixels x and y of the first view."""


class Completer(Protocol):
    """One view of an object -> its whole surface."""

    def surface(self, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Points [P, 3] of the object in the mask [S, S] of an image [S, S, 3]; z up; heading, place, size any."""


class PointMapper(Protocol):
    """Views -> the world point of each pixel, one map each, in order."""

    def point_maps(self, views: Iterable[View]) -> Iterator[PointMap]:
        """Point map of each view."""
