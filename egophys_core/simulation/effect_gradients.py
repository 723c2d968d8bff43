"""Derivatives by the parameters of effects, from those by what a batch holds: the chain rule.

An effect reaches the simulator through the arrays of a batch: numbers of its functions, stiffness, masses, hands,
what slides through them, frames. These are made anew a little beside each parameter, in float64, which costs next to
nothing.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from egophys_core.effects import TwinEffect, effect_named
from egophys_core.simulation.batch import RolloutBatch
from egophys_core.simulation.controls import Controls
from egophys_core.simulation.device_arrays import SPRING_NAMES
from egophys_core.simulation.gradients import Gradient
from egophys_core.simulation.model_batch import batch_of_models
from egophys_core.twin import ObjectModel

ADAPTED = ("gravity", "added_mass")
"""Parameters that effects change."""

SHARE = 1e-5
"""Of a parameter's step, by which it is changed."""


def effect_gradients(
    models: Sequence[ObjectModel],
    controls: Sequence[Controls],
    gradient: Gradient,
    *,
    starts: Sequence[np.ndarray] | None = None,
    velocities: Sequence[np.ndarray | None] | None = None,
    ground_height: float,
) -> tuple[dict[str, dict[str, float]], ...]:
    """Per model, by name of effect and parameter, the derivative of its loss, in units of the loss over its own.

    Jumps have no part in it: contacts begin and end where they do.

    Args:
        models, controls, starts, velocities, ground_height: of `batch_of_models`, which made the batch.
        gradient: of that batch, from `differentiate`.
    """
    beside = [
        (row, index, name, step)
        for row, model in enumerate(models)
        for index, term in enumerate(model.effects)
        for name, step in _steps(term).items()
    ]
    rows = [*range(len(models)), *(row for row, *_ in beside for _ in range(2))]
    changed = [
        _changed(models[row], index, name, sign * step) for row, index, name, step in beside for sign in (1.0, -1.0)
    ]
    batch = batch_of_models(
        # The models themselves come first, so that effects stand in the same order as in their batch.
        [*models, *changed],
        [controls[row] for row in rows],
        starts=None if starts is None else [starts[row] for row in rows],
        velocities=None if velocities is None else [velocities[row] for row in rows],
        ground_height=ground_height,
        dtype=np.float64,
    )
    found: tuple[dict[str, dict[str, float]], ...] = tuple({} for _ in models)
    for pair, (row, index, name, step) in enumerate(beside):
        above = len(models) + 2 * pair
        change = _along(gradient, row, batch, above) - _along(gradient, row, batch, above + 1)
        found[row].setdefault(models[row].effects[index].name, {})[name] = float(change / (2.0 * step))
    return found


def _steps(term: TwinEffect) -> dict[str, float]:
    """By how much each parameter is changed."""
    return {each.name: SHARE * each.step for each in effect_named(term.name).parameters}


def _changed(model: ObjectModel, index: int, name: str, by: float) -> ObjectModel:
    """The model with one parameter of one of its effects changed."""
    term = model.effects[index]
    other = replace(term, values={**term.values, name: term.values[name] + by})
    return replace(model, effects=(*model.effects[:index], other, *model.effects[index + 1 :]))


def _along(gradient: Gradient, row: int, batch: RolloutBatch, at: int) -> float:
    """The loss of a rollout as far as it is linear, for what row `at` of a batch holds."""
    total = sum(
        float((getattr(gradient, name)[row] * getattr(batch, name)[at]).sum())
        for name in (*SPRING_NAMES, "masses", "positions", "velocities")
    )
    total += float((gradient.controls[row] * batch.controls[at].positions).sum())
    times = batch.controls[at].times
    for slide in () if batch.slides is None else batch.slides[at]:
        total += float((gradient.slides[row] * slide(times[:-1], times[1:], gradient.pulls[row])).sum())
    for name in ADAPTED:
        total += float(gradient.parameters[name][row]) * getattr(batch.parameters[at], name)
    if batch.effects:
        total += float(gradient.effects[row] @ np.concatenate([each.numbers[at] for each in batch.effects]))
    if batch.frames is not None:
        total += float((gradient.frames[row] * batch.frames[at]).sum())
    return total
