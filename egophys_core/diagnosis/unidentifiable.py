"""Effects that a twin cannot tell in some episodes, whatever is in them."""

from collections.abc import Sequence

import numpy as np

from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import LIBRARY
from egophys_core.effects.traits import Need
from egophys_core.geometry import spacing, thick_axes
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel

COARSE = 0.35
"""Spacing of the nodes over the least extent that is not thin, from which a twin is too coarse to tell where it is
held. Two boxes that lack nothing, of 60 points (0.40), asked for hands 12 mm beside where they were, with gains of 383
and 175; of 100 points (0.33) and 200 (0.23) they did not."""


def unidentifiable_effects(model: ObjectModel, observations: Sequence[TrackedEpisode]) -> tuple[str, ...]:
    """Effects of the library to leave out of a diagnosis.

    Records of markers, and of what hangs, do not tell what a table does. What a clamp that stands still does to held
    points is how it was mounted. Where a twin of few nodes is held, these lie beside the hand.
    """
    absent = set(kind_of(model).cannot_tell)
    if all(each.free or each.observed.hangs for each in observations):
        absent.add(Need.TABLE)
    if all(each.mounted for each in observations):
        absent.add(Need.MOVING_GRIP)
    if is_coarse(model, observations):
        absent.add(Need.FINE_NODES)
    return tuple(effect.name for effect in LIBRARY.values() if effect.traits.needs & absent)


def why_not_looked_for(model: ObjectModel, observations: Sequence[TrackedEpisode]) -> str:
    """What to add to a reason where effects were left out that more points would tell."""
    if not is_coarse(model, observations):
        return ""
    return (
        "; the twin has too few nodes to tell where it is held, so what is off there, and where it is heavier, was not "
        "looked for: track more points and build it anew"
    )


def is_coarse(model: ObjectModel, observations: Sequence[TrackedEpisode]) -> bool:
    """Whether the nodes are too far apart to tell where hands hold them; what is in clamps is held at places known."""
    if any(each.observed.is_sparse for each in observations):
        return False
    surface = model.graph.positions[model.graph.surface]
    extents = np.ptp(surface, axis=0)
    return spacing(surface) > COARSE * float(extents[thick_axes(extents)].min())
