"""The rehearsal world a step at a time, for whoever moves the tool: a node that reads an arm, a test."""

from collections.abc import Mapping

import numpy as np

from egophys_core.errors import SimulationError
from egophys_core.geometry import turn_about_vertical
from egophys_core.interpolation import values_at
from egophys_core.rehearsal.bodies import make_body
from egophys_core.rehearsal.handled_body import HandledBody
from egophys_core.rehearsal.hands import Hands
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
        self._turns: list[float] = []
        self._first_points = np.zeros((0, 3))
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
            tool_points: [C, 3] metres, the same ones each time; the gripper is in their middle, and turns as they do
                about the vertical.
            duration: seconds, above zero.
            closed: whether the gripper is closed from the start of the step on; closing holds what is in reach.

        Returns:
            [N, 3] float32 metres, the object's points as observed at the end; NaN where not seen.

        Raises:
            SimulationError: the body diverged, or the tool's points are no finite [C, 3], or not as many as before.
        """
        tool_points = np.asarray(tool_points, float)
        if tool_points.ndim != 2 or tool_points.shape[1] != 3 or not np.isfinite(tool_points).all() or duration <= 0.0:
            raise SimulationError(
                f"the tool's points must be finite [C, 3] in metres and the duration above 0 s, "
                f"got {tool_points.shape} and {duration}"
            )
        if not self._times:
            self._first_points = tool_points
            self._record(self.time, tool_points)
        if tool_points.shape != self._first_points.shape:
            raise SimulationError(
                f"the tool had {len(self._first_points)} points before, and has {len(tool_points)} now"
            )
        hands_at = self._body.true_hands(self._hands_at)
        if closed != self._closed:
            if closed:
                self._body.close_grip(hands_at(self.time))
            else:
                self._body.open_grip()
            self._closed = closed
        self.time += duration
        self._record(self.time, tool_points)
        self._body.advance(hands_at, self.time)
        return observe(self._body.points, tool_points, self._options, self._body.effects, self._random)

    def _record(self, time: float, tool_points: np.ndarray) -> None:
        turn = turn_about_vertical(self._first_points, tool_points)
        self._times.append(time)
        self._centres.append(tool_points.mean(axis=0))
        self._turns.append(float(np.unwrap([*self._turns[-1:], turn])[-1]))
        while self._times[1:] and self._times[1] < time - LONGEST_DELAY:
            del self._times[0], self._centres[0], self._turns[0]

    def _hands_at(self, time: float) -> Hands:
        """The recorded tool at a time."""
        centre, turn = (values_at(self._times, record, time)[None] for record in (self._centres, self._turns))
        return Hands(centres=centre, turns=turn)
