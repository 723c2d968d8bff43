"""States of a body for injected forces: a few vertices, at rest unless told otherwise."""

from typing import Any

import numpy as np

from egophys_core.rehearsal.state import ForceTerm, StepState


def step_state(positions: Any, *, time: float = 0.0, duration: float = 1e-3, **arrays: Any) -> StepState:
    positions = np.array(positions, float)
    count = len(positions)
    return StepState(
        time=time,
        duration=duration,
        positions=positions,
        velocities=np.array(arrays.get("velocities", np.zeros((count, 3))), float),
        masses=np.array(arrays.get("masses", np.ones(count)), float),
        pressures=np.array(arrays.get("pressures", np.zeros(count)), float),
    )


def force_of(term: ForceTerm, state: StepState) -> np.ndarray:
    forces = np.zeros_like(state.positions)
    term(state, forces)
    return forces
