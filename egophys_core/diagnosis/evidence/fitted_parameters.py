"""Free parameters: those that a refit adjusts, the twin's own and those of its effects."""

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
class FreeParameter:
    """One parameter of a model, adjusted in steps of about equal effect."""

    definition: Parameter
    read: Callable[[ObjectModel], float]
    write: Callable[[ObjectModel, float], ObjectModel]

    def position(self, model: ObjectModel) -> float:
        """Where it stands, in steps."""
        return self.position_of(self.read(model))

    def position_of(self, value: float) -> float:
        """A value in steps."""
        return float(np.log(value) if self.definition.logarithmic else value) / self.definition.step

    def value_at(self, position: float) -> float:
        """The value at a position in steps, within its bounds."""
        scaled = position * self.definition.step
        value = float(np.exp(min(scaled, 700.0)) if self.definition.logarithmic else scaled)
        return float(np.clip(value, self.definition.low, self.definition.high))

    def to(self, model: ObjectModel, position: float) -> ObjectModel:
        """The model with this parameter at a position, within its bounds."""
        return self.write(model, self.value_at(position))


def with_values(model: ObjectModel, parameters: Sequence[FreeParameter], positions: np.ndarray) -> ObjectModel:
    """The model with all parameters at positions [D]."""
    for parameter, position in zip(parameters, positions, strict=True):
        model = parameter.to(model, float(position))
    return model


def baseline_parameters(model: ObjectModel) -> tuple[FreeParameter, ...]:
    """The parameters that every twin of this kind has, which are fitted with and without an effect."""
    return tuple(
        _physical_parameter(each.parameter)
        if each.springs is None
        else _springs_parameter(each.parameter, each.springs)
        for each in kind_of(model).fitted(model)
    )


def effect_parameters(effect: Effect) -> tuple[FreeParameter, ...]:
    """The parameters of an effect that the model carries."""
    return tuple(_effect_parameter(effect.name, parameter) for parameter in effect.parameters)


def effect_parameter(effect: Effect, name: str) -> FreeParameter:
    """One of them by its name."""
    return next(each for each in effect_parameters(effect) if each.definition.name == name)


def sizes_of(effect: Effect) -> tuple[str, ...]:
    """The parameters that say how much of an effect there is."""
    return tuple(each.name for each in effect.parameters if each.null is not None)


def at_null(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """Parameters of an effect with all sizes at null."""
    return {**values, **{each.name: each.null for each in effect.parameters if each.null is not None}}


def at_share(effect: Effect, there: Mapping[str, float], share: float) -> dict[str, float]:
    """Parameters of an effect at a share, in steps, of the distance from null."""
    null = at_null(effect, there)
    return {
        parameter.definition.name: parameter.value_at(
            (1.0 - share) * parameter.position_of(null[parameter.definition.name])
            + share * parameter.position_of(there[parameter.definition.name])
        )
        for parameter in effect_parameters(effect)
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


def _effect_parameter(name: str, parameter: Parameter) -> FreeParameter:
    def write(model: ObjectModel, value: float) -> ObjectModel:
        terms = tuple(
            replace(term, values={**term.values, parameter.name: value}) if term.name == name else term
            for term in model.effects
        )
        return replace(model, effects=terms)

    return FreeParameter(
        definition=parameter, read=lambda model: effect_values(model, name)[parameter.name], write=write
    )


def _physical_parameter(parameter: Parameter) -> FreeParameter:
    """One of the physical parameters."""

    def write(model: ObjectModel, value: float) -> ObjectModel:
        changed: dict[str, Any] = {parameter.name: value}
        return replace(model, parameters=replace(model.parameters, **changed))

    return FreeParameter(
        definition=parameter,
        read=lambda model: float(max(getattr(model.parameters, parameter.name), parameter.low)),
        write=write,
    )


def _springs_parameter(parameter: Parameter, kind: SpringKind) -> FreeParameter:
    """The median stiffness of one kind of springs; another value scales them all, and they carry what they carried."""

    def read(model: ObjectModel) -> float:
        of_kind = model.stiffness[model.graph.kinds == kind]
        return float(np.median(of_kind)) if len(of_kind) else 1.0

    def write(model: ObjectModel, value: float) -> ObjectModel:
        graph = model.graph
        scale = np.where(graph.kinds == kind, value / read(model), 1.0)
        seen = np.linalg.norm(np.diff(graph.positions[graph.springs].astype(np.float64), axis=1)[:, 0], axis=1)
        rest_lengths = (seen + (graph.rest_lengths - seen) / scale).astype(np.float32)
        return replace(
            model,
            graph=replace(graph, rest_lengths=np.maximum(rest_lengths, SHORTEST * seen.astype(np.float32))),
            stiffness=(model.stiffness * scale).astype(np.float32),
        )

    return FreeParameter(definition=parameter, read=read, write=write)
