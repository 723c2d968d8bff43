"""The substeps of one frame on Warp's tape, to be run forward and back again and again."""

import warp as wp

from egophys_core.lanes.state import StateArrays
from egophys_core.simulation.device_arrays import zeros
from egophys_core.simulation.substep import FrameInputs, SubstepArrays, substep_launches


class FrameTape:
    """All launches of a frame, recorded once: the arrays stay the same, their contents change.

    Recording by hand what `wp.Tape` would record anew for every frame saves most of the time of a launch.
    """

    def __init__(
        self, substeps: int, groups: int, nodes: int, controllers: int, memory: tuple[int, int], device: str
    ) -> None:
        """Room for the states before and after each of the substeps, and for what they are computed from."""

        def vectors(count: int) -> wp.array:
            return zeros(substeps, groups, count, 3, device=device, requires_grad=True)

        points = nodes + controllers
        self._positions = zeros(substeps + 1, groups, points, 3, device=device, requires_grad=True)
        self._velocities = zeros(substeps + 1, groups, points, 3, device=device, requires_grad=True)
        self._memory = zeros(substeps + 1, groups, *memory, device=device, requires_grad=True)
        self._forces, self._kicked = vectors(nodes), vectors(nodes)
        self._changes, self._collided = vectors(nodes), vectors(nodes)
        self._contacts = zeros(substeps, groups, nodes, device=device)
        self.substeps = substeps
        self.start, self.end = self._state(0), self._state(substeps)
        self._forward: list[wp.Launch] = []
        self._backward: list[wp.Launch] = []

    def record(self, inputs: FrameInputs) -> None:
        """Record the launches from `start` to `end` and back."""
        tape = wp.Tape()
        device = self._forces.device
        self._forward, self._backward = [], []
        for substep in range(self.substeps):
            after = self._state(substep + 1)
            out = SubstepArrays(
                forces=self._forces[substep],
                kicked=self._kicked[substep],
                contacts=self._contacts[substep],
                changes=self._changes[substep],
                collided=self._collided[substep],
                after=after,
            )
            for kernel, dim, read, written in substep_launches(substep, self._state(substep), inputs, out):
                self._forward.append(
                    wp.launch(kernel, dim=dim, inputs=read, outputs=written, device=device, record_cmd=True)
                )
                if kernel.options.get("enable_backward") is not False:
                    self._backward.append(
                        wp.launch(
                            kernel,
                            dim=dim,
                            inputs=read,
                            outputs=written,
                            adj_inputs=[tape.get_adjoint(value) for value in read],
                            adj_outputs=[tape.get_adjoint(value) for value in written],
                            device=device,
                            adjoint=True,
                            record_cmd=True,
                        )
                    )
        self._backward.reverse()

    def forward(self) -> None:
        """From the state in `start` to that in `end`."""
        for sums in (self._forces, self._changes, self._contacts):
            sums.zero_()
        for launch in self._forward:
            launch.launch()

    def backward(self) -> None:
        """From the derivatives in the gradients of `end` to those of `start` and of all inputs."""
        for launch in self._backward:
            launch.launch()

    def clear_derivatives(self) -> None:
        """Forget those of the last frame."""
        for array in (
            self._positions,
            self._velocities,
            self._memory,
            self._forces,
            self._kicked,
            self._changes,
            self._collided,
        ):
            array.grad.zero_()

    def _state(self, index: int) -> StateArrays:
        state = StateArrays()
        state.positions, state.velocities = self._positions[index], self._velocities[index]
        # Warp has no slices of arrays that hold nothing.
        state.memory = self._memory[index] if self._memory.size else self._memory.reshape((0, 0, 0))
        return state
