"""What effects of some sizes would leave unexplained once the twin was refitted without them.

Slopes do not say: a twin bends to make up for an effect, by friction for gravity, and what it bends by is soon far
beyond what slopes hold for. So it is let bend: residuals of a world like the recorded one, but with the effect, are
those that the twin leaves, changed by what the effect does to them; beside the effect they would be what they are.

What a model leaves is the same in all such worlds up to what is added. So the twin is refitted to all of them side by
side, and each model that is simulated for one counts in all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import effect_parameter, with_effect
from egophys_core.diagnosis.evidence.refit import LEAST_GAIN, Fitted, cell_losses, damped_steps, prior_loss
from egophys_core.diagnosis.hypotheses.ranking import Probe
from egophys_core.diagnosis.hypotheses.visited_models import VisitedModels
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.twin import ObjectModel

ROUNDS = 14
"""Of steps to each world, at most."""

DAMPINGS = (0.01, 1.0)
"""Levenberg-Marquardt's lambdas that are tried side by side."""

FAR_BELOW = 0.6
"""Of the gain that is needed: of what gains less it is not asked how little."""


@dataclass(frozen=True, kw_only=True)
class InjectedEffect:
    """What a world has."""

    probe: Probe
    """The effect and its other parameters."""
    size: str
    """Which of its sizes."""
    steps: float
    """How much of that; more than the twin has, if it has the effect already."""
    needed_gain: float
    """Whether it gains as much is asked."""


class AttainedGains:
    """Gains of effects in worlds that have them, where the twin is refitted without them as well as can be."""

    def __init__(self, observations: Sequence[TrackedEpisode], fitted: Fitted) -> None:
        """Begin at a fitted twin, with the parameters that are refitted."""
        self._fitted = fitted
        self._visited = VisitedModels(observations, fitted)

    def __call__(self, injected: Sequence[InjectedEffect]) -> list[float | None]:
        """The gains, in log-likelihood on fitted data; None of what the twin cannot be simulated with."""
        visited = self._visited
        changed = visited.simulated([_with_more(self._fitted.model, each) for each in injected])
        worlds = [
            _World(visited, self._fitted.scale, each.needed_gain, visited.left[0] - left)
            if np.isfinite(left).all()
            else None
            for left, each in zip(changed, injected, strict=True)
        ]
        simulable = [each for each in worlds if each is not None]

        def look() -> None:
            for each in simulable:
                each.look_at_new_models()

        open_worlds = simulable
        for _ in range(ROUNDS):
            open_worlds = [each for each in open_worlds if each.gain > FAR_BELOW * each.needed_gain]
            if not open_worlds:
                break
            before = {each: each.score for each in open_worlds}
            visited.visit([step for each in open_worlds for step in each.next_positions()])
            look()
            stalled = [each for each in open_worlds if each.score > before[each] - LEAST_GAIN]
            unknown = {each.best for each in stalled if not visited.has_neighbours(each.best)}
            open_worlds = [each for each in open_worlds if each not in stalled or each.best in unknown]
            if unknown:
                visited.visit_neighbours(sorted(unknown))
                look()
        return [None if each is None else each.gain for each in worlds]


class _World:
    """A world with an effect, and the visited models in it."""

    def __init__(self, visited: VisitedModels, scale: float, needed_gain: float, added: np.ndarray) -> None:
        """From what [M] metres the effect adds to what models leave."""
        self.needed_gain = needed_gain
        self._visited, self._scale, self._added = visited, scale, added
        self._unchanged = float(self._loss_of(visited.left[0]))
        self._losses, self._scores = np.zeros(0), np.zeros(0)
        self.look_at_new_models()

    @property
    def best(self) -> int:
        """Row of the model that fits this world best."""
        return int(self._scores.argmin())

    @property
    def score(self) -> float:
        """What a refit makes least, of the best."""
        return float(self._scores[self.best])

    @property
    def gain(self) -> float:
        """What the effect would gain beside the best."""
        return float(self._losses[self.best]) - self._unchanged

    def next_positions(self) -> list[np.ndarray]:
        """Where to go from the best, [D] each."""
        best = self.best
        at, left = self._visited.positions[best], self._visited.left[best] + self._added
        slopes, moved = self._visited.slopes(best), at - self._visited.positions[0]
        return [at + step for step in damped_steps([left], [slopes], self._scale, moved, DAMPINGS)]

    def look_at_new_models(self) -> None:
        """See which of the models that were visited since fit this world better."""
        known = len(self._scores)
        moved = self._visited.positions[known:] - self._visited.positions[0]
        losses = self._loss_of(self._visited.left[known:] + self._added)
        self._losses = np.concatenate([self._losses, losses])
        self._scores = np.concatenate([self._scores, losses + prior_loss(moved)])

    def _loss_of(self, left: np.ndarray) -> np.ndarray:
        """[...] of what is left [..., M]."""
        return np.asarray(cell_losses(left, self._scale))


def _with_more(model: ObjectModel, injected: InjectedEffect) -> ObjectModel:
    """The model with more of one size of an effect."""
    effect = injected.probe.effect
    carried = [each.values for each in model.effects if each.name == effect.name]
    values = dict(carried[0]) if carried else dict(injected.probe.null)
    parameter = effect_parameter(effect, injected.size)
    at = parameter.position_of(values[injected.size])
    values[injected.size] = parameter.value_at(at + injected.steps)
    return with_effect(model, effect.name, values)
