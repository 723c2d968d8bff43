"""Other twins of the object: an effect that it has helps these, too; one that makes up for how a twin is made does not.

In a toy that lacks nothing an effect of its material gained 207 beside one graph and grasp, and -29 to 26 beside four
others; added mass of another toy, a quarter of its own, 228, and 179 to 332 beside these (docs/notes/experiments.md).
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.cores import usable_cores
from egophys_core.diagnosis.evidence.baseline_twin import TriedTwin
from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, effect_parameters, with_effect
from egophys_core.diagnosis.evidence.judging import RefittedEffect, gain_on_left_out_data
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.refit import Fitted, losses_of, refit, refit_from
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import effect_named
from egophys_core.twin import ObjectModel

OTHERS = 2
"""Twins beside which an effect is asked for."""


@dataclass(frozen=True, kw_only=True)
class OtherTwin:
    """A twin of the same object with another graph or grasp."""

    plain: ObjectModel
    """Before it was refitted: it has not bent to make up for what it lacks."""
    fitted: Fitted


def other_twins(
    observations: Sequence[TrackedEpisode], before: Fitted, tried: Sequence[TriedTwin], *, iterations: int
) -> list[OtherTwin]:
    """The best twins of other graphs and grasps, refitted beside the same effects; none of an object with one graph.

    Args:
        before: the twin.
        tried: what it was chosen from: others begin there.
        iterations: most steps of each refit.
    """
    otherwise = [each.carrying(before.model.effects) for each in tried if not _made_alike(each.plain, before.model)]
    if not otherwise:
        return []
    losses = losses_of(observations, [each.refitted for each in otherwise], before.scale)

    def to_the_end(row: int) -> OtherTwin:
        start = otherwise[row].refitted
        parameters = baseline_parameters(start)
        fitted = refit(observations, start, parameters, iterations=iterations, scale=before.scale)
        return OtherTwin(plain=otherwise[row].plain, fitted=fitted)

    with ThreadPoolExecutor(usable_cores()) as pool:
        return list(pool.map(to_the_end, np.argsort(losses)[:OTHERS]))


def beside_other_twins(
    observations: Sequence[TrackedEpisode], effect: RefittedEffect, others: Sequence[OtherTwin], *, iterations: int
) -> RefittedEffect:
    """An effect with what it gains beside each other twin.

    Args:
        iterations: most steps of each refit.
    """
    with ThreadPoolExecutor(usable_cores()) as pool:
        gains = pool.map(lambda other: _gain_beside(observations, effect, other, iterations=iterations), others)
        return replace(effect, gains_beside_others=np.array(list(gains), dtype=np.float64))


def _gain_beside(
    observations: Sequence[TrackedEpisode], effect: RefittedEffect, other: OtherTwin, *, iterations: int
) -> float:
    """On left-out data; the other twin is refitted with the effect from where that ended, and without it from there."""
    own, scale = other.fitted.parameters, other.fitted.scale
    starts = [with_effect(model, effect.name, effect.values) for model in (other.fitted.model, other.plain)]
    parameters = (*own, *effect_parameters(effect_named(effect.name)))
    joint = refit_from(observations, starts, parameters, scale=scale, iterations=iterations)
    bare = replace(joint.model, effects=joint.model.effects[:-1])
    relieved = refit(observations, bare, own, iterations=iterations, scale=scale)
    without = min(other.fitted, relieved, key=lambda each: each.loss)
    return gain_on_left_out_data(joint, without, linear_problem(without.residuals, without.jacobian, scale))


def _made_alike(one: ObjectModel, other: ObjectModel) -> bool:
    """Whether two twins have the same graph and grasp."""
    radii = one.parameters.controller_radius, other.parameters.controller_radius
    return radii[0] == radii[1] and np.array_equal(one.graph.springs, other.graph.springs)
