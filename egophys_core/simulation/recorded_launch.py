"""A kernel launch that is packed once: most arguments of a frame are those of the frame before."""

from typing import Any

import warp as wp

from egophys_core.simulation.kernel_loading import KERNEL_LOADING


class RecordedLaunch:
    """Launches a kernel again and again. Packing arguments with structs in them takes longer than a small kernel.

    A tape does not see these launches: they have no gradient.
    """

    def __init__(self, kernel: wp.Kernel, dim: int | tuple[int, ...], device: Any) -> None:
        """Of so many threads on a Warp device."""
        self._kernel, self._dim, self._device = kernel, dim, device
        self._arguments: list[Any] = []
        self._launch: wp.Launch | None = None

    def __call__(self, *arguments: Any) -> None:
        """Launch; a struct whose own fields were set since is not packed anew, but one in its place is."""
        if self._launch is None:
            self._arguments = list(arguments)
            # What is recorded is where the kernel's code lies: it must not be loaded again meanwhile.
            with KERNEL_LOADING:
                self._launch = wp.launch(
                    self._kernel,
                    dim=self._dim,
                    inputs=self._arguments,
                    device=self._device,
                    record_tape=False,
                    record_cmd=True,
                )
        for index, (last, argument) in enumerate(zip(self._arguments, arguments, strict=True)):
            if argument is not last:
                self._launch.set_param_at_index(index, argument)
                self._arguments[index] = argument
        self._launch.launch()
