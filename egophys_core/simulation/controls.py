"""Controls: how the controller points move and when they hold the object."""

from dataclasses import dataclass

import numpy as np

from egophys_core.errors import SimulationError


@dataclass(frozen=True, kw_only=True)
class Controls:
    """Motion of C controller points over F frames."""

    times: np.ndarray
    """[F] float64, seconds, increasing; the simulation state is returned at these times."""
    positions: np.ndarray
    """[F, C, 3] float32, metres, world."""
    hold: np.ndarray
    """[F, C] bool: the point holds the nodes near it from the first frame of a run of True to its last."""

    def __post_init__(self) -> None:
        frames = len(self.times)
        if frames < 2 or not (np.diff(self.times) > 0).all():
            raise SimulationError(f"controls need at least 2 increasing times, got {frames}")
        if self.positions.ndim != 3 or self.positions.shape[0] != frames or self.positions.shape[2] != 3:
            raise SimulationError(f"controls must be [{frames}, C, 3] in metres, got {self.positions.shape}")
        if self.hold.shape != self.positions.shape[:2]:
            raise SimulationError(f"controls hold must be {self.positions.shape[:2]}, got {self.hold.shape}")
        if not np.isfinite(self.positions).all():
            frame, controller = np.argwhere(~np.isfinite(self.positions))[0][:2]
            raise SimulationError(f"controls: controller {controller} is not finite at frame {frame}")
