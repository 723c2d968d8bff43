"""Controls: how the controller points move and when they touch the object."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from egophys_core.errors import SimulationError


class ContactKind(IntEnum):
    """What a controller point does to the nodes near it."""

    NONE = 0
    HOLD = 1
    """Pulls and pushes the nodes it took hold of."""
    PRESS = 2
    """Pushes what comes nearer to it than the nearest node was when the contact began, and never pulls."""


@dataclass(frozen=True, kw_only=True)
class Controls:
    """Motion of C controller points over F frames."""

    times: np.ndarray
    """[F] float64, seconds, increasing; the simulation state is returned at these times."""
    positions: np.ndarray
    """[F, C, 3] float32, metres, world."""
    contact: np.ndarray
    """[F, C] uint8 `ContactKind`: a run of equal values is one contact, from its first frame to its last."""
    payload: np.ndarray | None = None
    """[N] kg, what each node carries beside the object's own mass, negative where it is lighter; None for nothing."""

    def __post_init__(self) -> None:
        frames = len(self.times)
        if frames < 2 or not (np.diff(self.times) > 0).all():
            raise SimulationError(f"controls need at least 2 increasing times, got {frames}")
        if self.positions.ndim != 3 or self.positions.shape[0] != frames or self.positions.shape[2] != 3:
            raise SimulationError(f"controls must be [{frames}, C, 3] in metres, got {self.positions.shape}")
        if self.contact.shape != self.positions.shape[:2]:
            raise SimulationError(f"controls contact must be {self.positions.shape[:2]}, got {self.contact.shape}")
        if not np.isin(self.contact, list(ContactKind)).all():
            raise SimulationError(f"controls contact must be 0, 1 or 2 (ContactKind), got {self.contact.max()}")
        if not np.isfinite(self.positions).all():
            frame, controller = np.argwhere(~np.isfinite(self.positions))[0][:2]
            raise SimulationError(f"controls: controller {controller} is not finite at frame {frame}")
        if self.payload is not None and not np.isfinite(self.payload).all():
            raise SimulationError(
                f"controls payload must be finite, got {self.payload[~np.isfinite(self.payload)][0]} kg"
            )

    def part(self, frames: slice) -> "Controls":
        """The same over some of the frames."""
        return replace(self, times=self.times[frames], positions=self.positions[frames], contact=self.contact[frames])
