"""Episode: what was observed of one handling of one object."""

from dataclasses import dataclass, replace

import numpy as np

from egophys_core.errors import EpisodeError

WORLD_FRAME = "world"
"""Name of the frame everything is in: right-handed, z up."""

LARGEST_SCENE_M = 20.0
"""Coordinates beyond this are taken for a wrong unit (millimetres) rather than a large object."""


LONGEST_GAP_S = 10.0
"""Seconds between two frames of one episode, all of which a rollout simulates. Where a camera lost the object they are
below 0.3 s in all recordings known; a clock that is set, or the break between two recordings, is longer."""


SHORTEST_STEP_S = 1e-4
"""Seconds from frame to frame, at the median: no camera or tracker is faster, but times in milliseconds are read so."""


class EpisodeWarning(UserWarning):
    """Something recorded was left out of an episode, filled in or is doubtful; says what and how much."""


@dataclass(frozen=True, kw_only=True)
class Episode:
    """Points of an object and of the hands that move it, over time. SI units, frame `world`, z up."""

    name: str
    """Where it came from, for messages and provenance; a file name, never an absolute path."""
    times: np.ndarray
    """[T] float64, seconds since the first frame, strictly increasing, times[0] == 0."""
    points: np.ndarray
    """[T, N, 3] float32, metres; NaN where the point was not seen in that frame."""
    confidence: np.ndarray
    """[T, N] float32 in 0..1; 0 where the point was not seen."""
    point_ids: np.ndarray
    """[N] uint32, stable over the episode, increasing."""
    controllers: np.ndarray
    """[T, C, 3] float32, metres; finite everywhere (short gaps are interpolated by the reader)."""
    controller_ids: np.ndarray
    """[C] uint32, stable over the episode, increasing."""
    ground_height: float = 0.0
    """z of the table, metres."""
    held: bool = False
    """Whether it was said that hands hold the object from the first frame to the last; else that is looked for."""
    contact: np.ndarray | None = None
    """[T, C] bool, where it was recorded that a controller holds the object; None where that is looked for. `held` has
    the last word."""
    no_table: bool = False
    """Whether it was said that there is no table; else that is looked for, too."""

    def __post_init__(self) -> None:
        points, controllers, times = self.points, self.controllers, self.times
        if points.ndim != 3 or points.shape[2] != 3:
            raise EpisodeError(f"{self.name}: object points must be [T, N, 3] in metres, got {points.shape}")
        frames, count = points.shape[:2]
        if frames < 2:
            raise EpisodeError(f"{self.name}: {frames} frame(s); motion needs at least 2. Record a longer episode")
        if count == 0:
            raise EpisodeError(f"{self.name}: no object points at all; check the object topic")
        if controllers.ndim != 3 or controllers.shape[0] != frames or controllers.shape[2] != 3:
            raise EpisodeError(
                f"{self.name}: controller points must be [{frames}, C, 3] in metres, got {controllers.shape}"
            )
        for label, array, shape in (
            ("times", times, (frames,)),
            ("confidence", self.confidence, (frames, count)),
            ("point_ids", self.point_ids, (count,)),
            ("controller_ids", self.controller_ids, (controllers.shape[1],)),
        ):
            if array.shape != shape:
                raise EpisodeError(f"{self.name}: {label} must be {shape}, got {array.shape}")
        if self.contact is not None and (self.contact.shape, self.contact.dtype) != (controllers.shape[:2], np.bool_):
            raise EpisodeError(
                f"{self.name}: contact must be bool {controllers.shape[:2]}, got {self.contact.dtype} "
                f"{self.contact.shape}"
            )
        _require_steady_times(times, self.name)
        if not np.isfinite(controllers).all():
            frame, index = np.argwhere(~np.isfinite(controllers))[0][:2]
            raise EpisodeError(
                f"{self.name}: controller {self.controller_ids[index]} is not finite at frame {frame}; "
                "drop that controller or interpolate it"
            )
        if np.isinf(points).any():
            frame, index = np.argwhere(np.isinf(points))[0][:2]
            raise EpisodeError(f"{self.name}: point {self.point_ids[index]} is infinite at frame {frame}")
        if not self.visible.any(axis=1)[0]:
            raise EpisodeError(f"{self.name}: no object point is visible in the first frame; start the bag later")
        self._require_metres("points", points)
        self._require_metres("controllers", controllers)

    def _require_metres(self, label: str, places: np.ndarray) -> None:
        largest = float(np.nanmax(np.abs(places), initial=0.0))
        if largest > LARGEST_SCENE_M:
            raise EpisodeError(
                f"{self.name}: a coordinate of {largest:.3g} m among the {label}, which must be in metres: divide "
                "millimetres by 1000, centimetres by 100"
            )

    @property
    def visible(self) -> np.ndarray:
        """[T, N] bool: where a point was seen."""
        return np.isfinite(self.points).all(axis=2)

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.times)

    def from_frame(self, first: int) -> "Episode":
        """The episode from a frame on, which is its first then."""
        return replace(
            self,
            times=self.times[first:] - self.times[first],
            points=self.points[first:],
            confidence=self.confidence[first:],
            controllers=self.controllers[first:],
            contact=None if self.contact is None else self.contact[first:],
        )

    @property
    def train_frames(self) -> int:
        """Number of frames that are fitted, floor(0.7 T); frames from this one on are held out (paper, Sec. 4.1)."""
        return self.frames * 7 // 10


def _require_steady_times(times: np.ndarray, name: str) -> None:
    steps = np.diff(times)
    if not np.all(steps > 0):
        frame = int(np.argmin(steps > 0)) + 1
        raise EpisodeError(f"{name}: time does not increase at frame {frame} (t={times[frame]:.3f} s)")
    if np.median(steps) < SHORTEST_STEP_S:
        raise EpisodeError(
            f"{name}: {len(times)} frames span {times[-1] - times[0]:.2g} s, from one to the next "
            f"{np.median(steps):.2g} s, at least {SHORTEST_STEP_S:g} s; times must be in seconds, and stamps "
            "in nanoseconds"
        )
    if steps.max() > LONGEST_GAP_S:
        frame = int(np.argmax(steps > LONGEST_GAP_S))
        raise EpisodeError(
            f"{name}: {steps[frame]:.3f} s pass from frame {frame} (t={times[frame]:.3f} s) to frame {frame + 1} "
            f"(t={times[frame + 1]:.3f} s), in one episode at most {LONGEST_GAP_S:g} s; cut it there into two"
        )
