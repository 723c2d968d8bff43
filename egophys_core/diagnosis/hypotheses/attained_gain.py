"""What an effect of a size would leave unexplained once the twin was refitted without it.

Slopes do not say: a twin bends to make up for an effect, by friction for gravity, and what it bends by is soon far
beyond what slopes hold for. So it is let bend: residuals of a world like the recorded one, but with the effect, are
those that the twin leaves, changed by what the effect does to them; beside the effect they would be what they are.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import effect_parameter, with_effect
from egophys_core.diagnosis.evidence.refit import Fitted, refit_further
from egophys_core.diagnosis.evidence.residuals import TrackedEpisode, residuals
from egophys_core.diagnosis.hypotheses.ranking import Probe
from egophys_core.twin import ObjectModel

STEPS = 6
"""Of a refit of the twin to a world with an effect. Of a gravity less by 0.4 that a sheet lacked in a fast drag, slopes
said that it gains 170 or more, a refit of one step 133, of three 95, of six 57; a diagnosis gained 51."""


def attained_gain(
    observations: Sequence[TrackedEpisode], fitted: Fitted, probe: Probe, size: str, steps: float
) -> float | None:
    """The gain of an effect in a world that has it, where the twin is refitted without it as well as can be.

    Args:
        fitted: the twin, and the parameters that are refitted. If it has the effect already, a world is meant that has
            as much more of it.
        probe: the effect and its other parameters.
        size: which of its sizes it has.
        steps: how much of it.

    Returns:
        In log-likelihood, on fitted data; None if the twin cannot be simulated with it.
    """
    lacking = _with_more(fitted.model, probe, size, steps)
    changed = [found[0] for found in residuals(observations, [lacking])]
    if not all(np.isfinite(each[np.isfinite(own)]).all() for each, own in zip(changed, fitted.residuals, strict=True)):
        return None
    added = [own - each for own, each in zip(fitted.residuals, changed, strict=True)]
    world = [replace(each, added=more) for each, more in zip(observations, added, strict=True)]
    start = replace(fitted, residuals=[own + more for own, more in zip(fitted.residuals, added, strict=True)])
    return refit_further(world, start, iterations=STEPS, turns=False).loss - fitted.loss


def _with_more(model: ObjectModel, probe: Probe, size: str, steps: float) -> ObjectModel:
    """The model with more of one size of an effect, by steps."""
    name = probe.effect.name
    carried = [each.values for each in model.effects if each.name == name]
    values = dict(carried[0]) if carried else dict(probe.null)
    parameter = effect_parameter(probe.effect, size)
    values[size] = parameter.value_at(parameter.position_of(values[size]) + steps)
    return with_effect(model, name, values)
