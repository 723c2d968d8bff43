"""Free parameters: those that a refit adjusts, the twin's own and those of its effects."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from egophys_core.effects import Effect, Parameter, TwinEffect, effect_named
from egophys_core.simulation import longest_retardation
from egophys_core.twin import ObjectKind, ObjectModel, SpringKind
from egophys_core.twin.parameters import GRAVITY, NATURAL_BEND

STIFFEST = 1e6
"""1/s^2, largest spring stiffness over node mass: a held toy may not sag where the real one does not."""


SHORTEST = 0.2
"""Of its length as seen: the rest length that a spring has at least, however soft."""

BEND_STEP = 0.2
"""Rad of intrinsic curvature from one end of a rod to the other: a step."""


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


def baseline_parameters(model: ObjectModel, *, clamped: bool) -> tuple[FreeParameter, ...]:
    """The parameters that every twin of this kind has, which are fitted with and without an effect.

    Args:
        clamped: whether the object is held in a clamp, not by a hand: then its static deflection tells how stiff it is.
    """
    if model.kind == ObjectKind.ROD:
        return _rod_parameters(model)
    node_mass = model.parameters.total_mass / len(model.graph.positions)
    top_damping = 5.0 if model.kind == ObjectKind.SHEET else 30.0
    # A template of a stiff material is built beyond these bounds; they then move with it.
    room = max(1.0, 3.0 * model.parameters.stiffness / (STIFFEST * node_mass))
    parameters = [
        _springs_parameter("stiffness", SpringKind.STRUCTURAL, 1e2 * node_mass, room * STIFFEST * node_mass),
        _physical_parameter(
            "damping", 0.01 * node_mass, room * top_damping * node_mass, step=0.5, unit="N s/m", logarithmic=True
        ),
        _physical_parameter("friction", 0.0, 2.0, step=0.05),
        _physical_parameter(
            "controller_stiffness", 1e2 * node_mass, room * STIFFEST * node_mass, step=0.5, unit="N/m", logarithmic=True
        ),
    ]
    if model.kind == ObjectKind.SHEET:
        bending = _springs_parameter("bending stiffness", SpringKind.BENDING, 1.0 * node_mass, 1e5 * node_mass)
        return (*parameters, bending, _physical_parameter("compression_ratio", 0.05, 1.0, step=0.3, logarithmic=True))
    parameters.append(_physical_parameter("drag", 0.0, 20.0, step=0.2, unit="1/s"))
    if not clamped:
        # A grip that is soft enough to turn in is too soft to carry: all toys deflect too far in their twins. What a
        # toy weighs, how stiff it is and how firmly it is held are one thing there: its deflection is no evidence.
        parameters.append(_physical_parameter("gravity", 0.5 * GRAVITY, 1.2 * GRAVITY, step=0.5, unit="m/s^2"))
    return tuple(parameters)


def _rod_parameters(model: ObjectModel) -> tuple[FreeParameter, ...]:
    """How a rod resists bending, how it is damped and its intrinsic curvature; it hardly stretches, and its clamps do
    not give way."""
    length = float(model.graph.rest_lengths.sum())
    # A rod of these rigidities bends under its own weight within 1 % of its length, and within all of it.
    low, high = (model.parameters.total_mass * GRAVITY * share**3 * length**2 for share in (0.01, 1.0))
    longest = longest_retardation(model.parameters.flexural_rigidity, model.graph.rest_lengths, model.node_masses)
    return (
        _physical_parameter("flexural_rigidity", low, high, step=0.1, unit="N m^2", logarithmic=True),
        _physical_parameter(
            "retardation_time", min(1e-5, longest / 2.0), longest, step=0.5, unit="s", logarithmic=True
        ),
        _physical_parameter("drag", 0.0, 20.0, step=0.2, unit="1/s"),
        *(
            _physical_parameter(name, -2.0 * np.pi / length, 2.0 * np.pi / length, step=BEND_STEP / length, unit="1/m")
            for name in NATURAL_BEND
        ),
    )


def effect_parameters(effect: Effect) -> tuple[FreeParameter, ...]:
    """The parameters of an effect that the model carries."""
    return tuple(_effect_parameter(effect.name, parameter) for parameter in effect.parameters)


def sizes_of(effect: Effect) -> tuple[str, ...]:
    """The parameters that say how much of an effect there is."""
    return tuple(each.name for each in effect.parameters if each.null is not None)


def at_null(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """Parameters of an effect with all sizes at null."""
    return {**values, **{each.name: each.null for each in effect.parameters if each.null is not None}}


def part_way(effect: Effect, there: Mapping[str, float], share: float) -> dict[str, float]:
    """Parameters at a share, in steps, of the distance from no effect."""
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


def _physical_parameter(
    name: str, low: float, high: float, *, step: float, unit: str = "1", logarithmic: bool = False
) -> FreeParameter:
    def write(model: ObjectModel, value: float) -> ObjectModel:
        changed: dict[str, Any] = {name: value}
        return replace(model, parameters=replace(model.parameters, **changed))

    return FreeParameter(
        definition=Parameter(name=name, unit=unit, low=low, high=high, step=step, logarithmic=logarithmic),
        read=lambda model: float(max(getattr(model.parameters, name), low)),
        write=write,
    )


def _springs_parameter(name: str, kind: SpringKind, low: float, high: float) -> FreeParameter:
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

    return FreeParameter(
        definition=Parameter(name=name, unit="N/m", low=low, high=high, step=0.3, logarithmic=True),
        read=read,
        write=write,
    )
