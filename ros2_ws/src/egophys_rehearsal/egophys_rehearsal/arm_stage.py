"""The object handled by the arm: the world is stepped along the tool's measured path. Imports no ROS."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from egophys_core.rehearsal import RehearsalOptions, RehearsalWorld
from egophys_core.waypoint_plan import NANOSECONDS
from egophys_rehearsal.frame import RehearsalFrame
from egophys_rehearsal.tool_track import ToolTrack

AT_REST_S = 10.0
"""After so long without motion of the tool or the gripper the object is at rest; creep takes seconds."""
IDLE_PERIOD_S = 0.5
"""How often an object at rest is looked at."""
SILENCE_S = 2.0
"""A tool whose pose has not come for so long is reported."""


class ArmStage:
    """Follows the tool in its own time.

    Frames carry the time the tool was there. A world that is slower than time shows them late and catches up while
    nothing moves, for then it stands still.
    """

    def __init__(
        self,
        options: RehearsalOptions,
        *,
        seed: int,
        object_seed: int,
        effects: Mapping[str, Mapping[str, float]],
        track: ToolTrack,
        cloud: np.ndarray,
    ) -> None:
        """Lay the object on the table, which takes seconds.

        Args:
            options: the object and how it is seen.
            seed: of noise.
            object_seed: of the object.
            effects: what is injected.
            track: where the tool is; the caller adds to it.
            cloud: [C, 3] metres, points of the tool in its frame, their mean 0.

        Raises:
            EgophysError: an effect is unknown, or MuJoCo is not installed.
        """
        self._world = RehearsalWorld(options, seed=seed, effects=effects, object_seed=object_seed)
        self._track = track
        self._cloud = cloud
        self._period_ns = round(NANOSECONDS / options.rate_hz)
        self._shown_ns: int | None = None

    def due(self, now_ns: int) -> Callable[[], RehearsalFrame] | None:
        """What makes the next frame."""
        newest = self._track.newest_ns
        if newest is None:
            return None
        if self._shown_ns is None:
            self._shown_ns = newest
        since = self._shown_ns - round(AT_REST_S * NANOSECONDS)
        still = self._track.still_until(self._shown_ns, since_ns=since)
        stamp = max(still, self._shown_ns + self._period_ns)
        is_at_rest = newest - still < self._period_ns
        if is_at_rest and 0 < still - self._shown_ns < IDLE_PERIOD_S * NANOSECONDS:
            return None
        if newest < stamp:
            return None
        self._shown_ns = stamp
        self._track.forget_before(since)
        points, closed = self._track.points_at(stamp, self._cloud), self._track.is_closed(stamp)
        return partial(self._step, stamp, points, closed)

    def status(self, now_ns: int) -> str:
        """How far behind the tool the object is."""
        newest = self._track.newest_ns
        if newest is None or now_ns - newest > SILENCE_S * NANOSECONDS:
            return "no tool pose; is the bridge active?"
        behind = 0.0 if self._shown_ns is None else (newest - self._shown_ns) / NANOSECONDS
        return f"follows the tool, {behind:.1f} s behind"

    def _step(self, stamp_ns: int, hands: np.ndarray, closed: bool) -> RehearsalFrame:
        points = self._world.step(hands, self._period_ns / NANOSECONDS, closed=closed)
        return RehearsalFrame(stamp_ns=stamp_ns, points=points, hands=hands)
