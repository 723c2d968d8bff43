"""What objects that are held in clamps have in common."""

from egophys_core.kinds.kind import MarkerBody
from egophys_core.twin import PhysicalParameters

OVERDAMPED = 20.0
"""1/s, a drag that leaves static deflection and no ring-down."""

SOME_DRAG = 1.0
"""1/s, first guess."""

CLAMP_STIFFNESS = 5.0
"""Stiffness with which a clamped node is held over that of a spring; more asks for more substeps."""

CLAMP_RADIUS = 0.3
"""Of a clamped point, in cells: it holds its own node."""


def clamped_parameters(
    body: MarkerBody, *, density: float, stiffness: float, damping: float, drag: float
) -> PhysicalParameters:
    """Of springs of one stiffness, N/m, and dashpot, N s/m, and of clamps, each point of which holds its own node."""
    return PhysicalParameters(
        total_mass=density * body.volume,
        stiffness=stiffness,
        damping=damping,
        drag=drag,
        strain_limit=1e6,
        controller_stiffness=CLAMP_STIFFNESS * stiffness,
        controller_radius=CLAMP_RADIUS * body.spacing,
        controller_neighbours=1,
    )
