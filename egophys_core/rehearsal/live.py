"""The rehearsal world a step at a time, for whoever moves the tool: a node that reads an arm, a test."""

from collections.abc import Mapping

import numpy as np

from egophys_core.errors import SimulationError
from egophys_core.interpolation import values_at
from egophys_core.rehearsal.bodies import make_body
from egophys_core.rehearsal.handled_body import HandledBody
from egophys_core.rehearsal.injection import complete_effects
from egophys_core.rehearsal.observation import observe
from egophys_core.rehearsal.options import RehearsalOptions

LONGEST_DELAY = 2.0
"""Seconds of the tool's past that are kept for an injected delay."""


class RehearsalWorld:
    """One body on a table and one tool with a gripper."""

    def __init__(
        self,
        options: RehearsalOptions,
        *,
        seed: int,
        effects: Mapping[str, Mapping[str, float]],
        object_seed: int = 0,
    ) -> None:
        """Lay the object on the table; time is zero.

        Args:
            options: the object and how it is observed; its duration and rate do not matter here.
            seed: of noise and dropouts.
            effects: what is injected, by name; parameters not given have their small size.
            object_seed: of the object.

        Raises:
            OptionsError: an effect or parameter is unknown; suggests the nearest.
            EgophysError: MuJoCo is not installed.
        """
        self._options = options
        self._random = np.random.default_rng([seed, object_seed])
        self._body = HandledBody(make_body(options, object_seed), complete_effects(effects))
        self._times: list[float] = []
        self._centres: list[np.ndarray] = []
        self._closed = False
        self.time = 0.0
        """Seconds since the start."""

    @property
    def points(self) -> np.ndarray:
        """[N, 3] metres, where the tracked points truly are."""
        return self._body.points

    def step(self, tool_points: np.ndarray, duration: float, *, closed: bool) -> np.ndarray:
        """Move the tool to where it is `duration` later, along a straight line.

        Args:
            tool_points: [C, 3] metres; the gripper is in their middle.
            duration: seconds, above zero.
            closed: whether the gripper is closed from the start of the step on; closing holds what is in reach.

        Returns:
            [N, 3] float32 metres, the object's points as observed at the end; NaN where not seen.

        Raises:
            SimulationError: the body diverged, or the tool's points are no finite [C, 3].
        """
        tool_points = np.asarray(tool_points, float)
        if tool_points.ndim != 2 or tool_points.shape[1] != 3 or not np.isfinite(tool_points).all() or duration <= 0.0:
            raise SimulationError(
                f"the tool's points must be finite [C, 3] in metres and the duration above 0 s, "
                f"got {tool_points.shape} and {duration}"
            )
        if not self._times:
            self._record(self.time, tool_points.mean(axis=0))
        hands_at = self._body.true_hands(self._centre_at)
        if closed != self._closed:
            if closed:
                self._body.close_grip(hands_at(self.time))
            else:
                self._body.open_grip()
            self._closed = closed
        self.time += duration
        self._record(self.time, tool_points.mean(axis=0))
        self._body.advance(hands_at, self.time)
        return observe(self._body.points, tool_points, self._options, self._body.effects, self._random)

    def _record(self, time: float, centre: np.ndarray) -> None:
        self._times.append(time)
        self._centres.append(centre)
        while self._times[1:] and self._times[1] < time - LONGEST_DELAY:
            del self._times[0], self._centres[0]

    def _centre_at(self, time: float) -> np.ndarray:
        """[1, 3] metres, the recorded tool at a time."""
        return values_at(self._times, self._centres, time)[None]
