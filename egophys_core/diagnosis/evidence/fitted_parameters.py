"""Knobs: the numbers of a twin that a refit turns, its own and those of its effects."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from egophys_core.effects import Effect, Parameter, TwinEffect, effect_named
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel, SpringKind

SHORTEST = 0.2
"""Of its length as seen: the rest length that a spring has at least, however soft."""


@dataclass(frozen=True, kw_only=True)
class Knob:
    """One number of a model, turned in steps of about equal effect."""

    parameter: Parameter
    read: Callable[[ObjectModel], float]
    turn: Callable[[ObjectModel, float], ObjectModel]

    def position(self, model: ObjectModel) -> float:
        """Where it stands, in steps."""
        return self.position_of(self.read(model))

    def position_of(self, value: float) -> float:
        """A value in steps."""
        return float(np.log(value) if self.parameter.logarithmic else value) / self.parameter.step

    def value_at(self, position: float) -> float:
        """The value at a position in steps, within its bounds."""
        scaled = position * self.parameter.step
        value = float(np.exp(min(scaled, 700.0)) if self.parameter.logarithmic else scaled)
        return float(np.clip(value, self.parameter.low, self.parameter.high))

    def to(self, model: ObjectModel, position: float) -> ObjectModel:
        """The model with this knob at a position; within its bounds."""
        return self.turn(model, self.value_at(position))


def turned(model: ObjectModel, knobs: Sequence[Knob], positions: np.ndarray) -> ObjectModel:
    """The model with all knobs at positions [D]."""
    for knob, position in zip(knobs, positions, strict=True):
        model = knob.to(model, float(position))
    return model


def base_knobs(model: ObjectModel) -> tuple[Knob, ...]:
    """The numbers every twin of this kind has, which are fitted with and without an effect."""
    return tuple(
        _number(each.parameter) if each.springs is None else _springs_knob(each.parameter, each.springs)
        for each in kind_of(model).fitted(model)
    )


def effect_knobs(effect: Effect) -> tuple[Knob, ...]:
    """The parameters of an effect that the model carries."""
    return tuple(_effect_knob(effect.name, parameter) for parameter in effect.parameters)


def sizes_of(effect: Effect) -> tuple[str, ...]:
    """The parameters that say how much of an effect there is."""
    return tuple(each.name for each in effect.parameters if each.null is not None)


def at_null(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """Parameters of an effect with all sizes at null."""
    return {**values, **{each.name: each.null for each in effect.parameters if each.null is not None}}


def part_way(effect: Effect, there: Mapping[str, float], share: float) -> dict[str, float]:
    """Parameters at a share, in steps, of the way from no effect."""
    null = at_null(effect, there)
    return {
        knob.parameter.name: knob.value_at(
            (1.0 - share) * knob.position_of(null[knob.parameter.name])
            + share * knob.position_of(there[knob.parameter.name])
        )
        for knob in effect_knobs(effect)
    }


def with_effect(model: ObjectModel, name: str, values: dict[str, float]) -> ObjectModel:
    """The model with an effect, in place of one of the same name."""
    others = tuple(term for term in model.effects if term.name != name)
    known = {parameter.name for parameter in effect_named(name).parameters}
    if known != set(values):
        raise ValueError(f"{name} has parameters {sorted(known)}, got {sorted(values)}")
    return replace(model, effects=(*others, TwinEffect(name=name, values=dict(values))))


def effect_values(model: ObjectModel, name: str) -> dict[str, float]:
    """The parameters of an effect that the model carries."""
    return next(term.values for term in model.effects if term.name == name)


def _effect_knob(name: str, parameter: Parameter) -> Knob:
    def turn(model: ObjectModel, value: float) -> ObjectModel:
        terms = tuple(
            replace(term, values={**term.values, parameter.name: value}) if term.name == name else term
            for term in model.effects
        )
        return replace(model, effects=terms)

    return Knob(parameter=parameter, read=lambda model: effect_values(model, name)[parameter.name], turn=turn)


def _number(parameter: Parameter) -> Knob:
    """One of the physical parameters."""

    def turn(model: ObjectModel, value: float) -> ObjectModel:
        changed: dict[str, Any] = {parameter.name: value}
        return replace(model, parameters=replace(model.parameters, **changed))

    return Knob(
        parameter=parameter,
        read=lambda model: float(max(getattr(model.parameters, parameter.name), parameter.low)),
        turn=turn,
    )


def _springs_knob(parameter: Parameter, kind: SpringKind) -> Knob:
    """The median stiffness of one kind of springs; turning it scales them all, and they carry what they carried."""

    def read(model: ObjectModel) -> float:
        of_kind = model.stiffness[model.graph.kinds == kind]
        return float(np.median(of_kind)) if len(of_kind) else 1.0

    def turn(model: ObjectModel, value: float) -> ObjectModel:
        graph = model.graph
        scale = np.where(graph.kinds == kind, value / read(model), 1.0)
        seen = np.linalg.norm(np.diff(graph.positions[graph.springs].astype(np.float64), axis=1)[:, 0], axis=1)
        rest_lengths = (seen + (graph.rest_lengths - seen) / scale).astype(np.float32)
        return replace(
            model,
            graph=replace(graph, rest_lengths=np.maximum(rest_lengths, SHORTEST * seen.astype(np.float32))),
            stiffness=(model.stiffness * scale).astype(np.float32),
        )

    return Knob(parameter=parameter, read=read, turn=turn)
