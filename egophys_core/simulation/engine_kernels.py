"""The kernels that an engine launches, loaded before it launches any."""

import warp as wp

from egophys_core.simulation.collision.pair_search import bound_clusters
from egophys_core.simulation.extremes import find_extremes
from egophys_core.simulation.kernel_loading import KERNEL_LOADING
from egophys_core.simulation.power_iteration import iterate_power
from egophys_core.simulation.step import frame_kernel
from egophys_core.simulation.terms.codebook import predict_stiffness
from egophys_core.simulation.terms.effects import EffectTerms
from egophys_core.simulation.terms.material_frames import settle_material_frames

KERNELS = (bound_clusters, find_extremes, iterate_power, predict_stiffness, settle_material_frames)
"""One of each module beside that of the frame's own kernel."""


def load_kernels(terms: EffectTerms | None, device: str) -> None:
    """Load all modules that an engine with some effects launches, unless they are: engines may begin in threads."""
    with KERNEL_LOADING:
        for kernel in (frame_kernel(terms), *KERNELS):
            wp.load_module(kernel.module, device=device)
