"""What effects and the simulator both need of Warp: lanes, and the state and parameters of rollouts in kernels."""

from egophys_core.lanes.packing import LANES, Lanes, group_count, pack, unpack

__all__ = ["LANES", "Lanes", "group_count", "pack", "unpack"]
