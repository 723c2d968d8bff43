"""The object handled by scripted hands, once. Imports no ROS."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from egophys_core.rehearsal import Motion, RehearsalOptions, rehearse
from egophys_core.waypoint_plan import NANOSECONDS
from egophys_rehearsal.frame import RehearsalFrame


class ScriptStage:
    """Rehearses an episode, then shows it in its own time from the first look on."""

    def __init__(
        self,
        options: RehearsalOptions,
        motion: Motion,
        *,
        seed: int,
        object_seed: int,
        effects: Mapping[str, Mapping[str, float]],
    ) -> None:
        """Rehearse, which takes longer than the episode lasts.

        Raises:
            EgophysError: an effect is unknown, MuJoCo is not installed, or the object diverged.
        """
        self._episode = rehearse(options, motion, seed=seed, effects=effects, object_seed=object_seed)
        self._points = np.full((self._episode.frames, options.points, 3), np.nan, np.float32)
        self._points[:, self._episode.point_ids] = self._episode.points
        self._begin_ns: int | None = None
        self._shown = 0

    def due(self, now_ns: int) -> Callable[[], RehearsalFrame] | None:
        """What makes the next frame."""
        if self._begin_ns is None:
            self._begin_ns = now_ns
        if self._shown == self._episode.frames:
            return None
        stamp_ns = self._begin_ns + round(float(self._episode.times[self._shown]) * NANOSECONDS)
        if stamp_ns > now_ns:
            return None
        self._shown += 1
        return partial(self._frame, self._shown - 1, stamp_ns)

    def status(self, now_ns: int) -> str:
        """How much has been shown."""
        shown = f"{self._shown} of {self._episode.frames} frames shown"
        return f"{shown}; call ~/reset to begin anew" if self._shown == self._episode.frames else shown

    def _frame(self, index: int, stamp_ns: int) -> RehearsalFrame:
        return RehearsalFrame(stamp_ns=stamp_ns, points=self._points[index], hands=self._episode.controllers[index])
