"""Advancing a state by the substeps of a frame: in one launch on a CPU, as a CUDA graph on a GPU."""

from collections.abc import Callable

import warp as wp

from egophys_core.lanes.state import StateArrays
from egophys_core.simulation.device_arrays import substep_arrays
from egophys_core.simulation.recorded_launch import RecordedLaunch
from egophys_core.simulation.step import frame_kernel
from egophys_core.simulation.substep import FrameInputs, SubstepArrays, find_divergences, launch_substep

FrameAdvance = Callable[[StateArrays, int, FrameInputs], None]
"""Called with the state, which is advanced in place, the number of substeps and what they read."""


def frame_advance(groups: int, nodes: int, controllers: int, memory: tuple[int, int], device: str) -> FrameAdvance:
    """The way of this device; `memory` are the springs and how many numbers each of them remembers."""
    if wp.get_device(device).is_cpu:
        # There the state is advanced in place, with what springs remember.
        return _LaunchAdvance(substep_arrays(groups, nodes, controllers, (0, 0), device))
    out = [substep_arrays(groups, nodes, controllers, memory, device) for _ in range(2)]
    return _GraphAdvance((out[0], out[1]))


class _LaunchAdvance:
    """One launch a frame, always with the terms of the first one."""

    def __init__(self, scratch: SubstepArrays) -> None:
        self._scratch = scratch
        self._launch: RecordedLaunch | None = None

    def __call__(self, state: StateArrays, substeps: int, inputs: FrameInputs) -> None:
        scratch = self._scratch
        if self._launch is None:
            self._launch = RecordedLaunch(frame_kernel(inputs.terms), scratch.forces.shape[0], scratch.forces.device)
        self._launch(
            state,
            scratch.forces,
            inputs.springs,
            inputs.grips,
            inputs.presses,
            inputs.controllers,
            inputs.parameters,
            inputs.rods,
            inputs.nudging,
            inputs.effects,
            inputs.pairs,
            scratch.contacts,
            scratch.changes,
            inputs.frame,
        )


def advance_by_substeps(
    state: StateArrays, substeps: int, inputs: FrameInputs, out: tuple[SubstepArrays, SubstepArrays]
) -> None:
    """Advance `state` in place by launches of single substeps, with two sets of arrays by turns."""
    groups, nodes = out[0].contacts.shape
    here = state
    for substep in range(substeps):
        target = out[substep % 2]
        for sums in (target.forces, target.contacts, target.changes):
            sums.zero_()
        launch_substep(substep, here, inputs, target)
        here = target.after
        wp.launch(find_divergences, dim=(groups, nodes), inputs=[substep, here, inputs.frame], device=sums.device)
    wp.copy(state.positions, here.positions)
    wp.copy(state.velocities, here.velocities)
    if state.memory.size:
        wp.copy(state.memory, here.memory)


class _GraphAdvance:
    """Records the launches of a frame as a CUDA graph and replays it as long as they use the same arrays."""

    def __init__(self, out: tuple[SubstepArrays, SubstepArrays]) -> None:
        self._out = out
        self._recorded: tuple[int, int] | None = None
        self._graph: wp.Graph | None = None

    def __call__(self, state: StateArrays, substeps: int, inputs: FrameInputs) -> None:
        arrays = (inputs.grips.starts.ptr, substeps)
        if inputs.pairs.count > 0 or arrays != self._recorded:
            # The pairs change with every frame; the first of equal frames also loads the kernels.
            advance_by_substeps(state, substeps, inputs, self._out)
            self._recorded, self._graph = (None if inputs.pairs.count > 0 else arrays), None
            return
        device = self._out[0].forces.device
        if self._graph is None:
            with wp.ScopedCapture(device) as capture:
                advance_by_substeps(state, substeps, inputs, self._out)
            self._graph = capture.graph
        wp.capture_launch(self._graph)
