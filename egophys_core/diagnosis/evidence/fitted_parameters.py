"""Knobs: the numbers of a twin that a refit turns, its own and those of its effects."""

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
"""Rad by which a rod turns from one end to the other by nature: a step."""


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


def base_knobs(model: ObjectModel, *, clamped: bool) -> tuple[Knob, ...]:
    """The numbers every twin of this kind has, which are fitted with and without an effect.

    Args:
        clamped: whether the object is held in a clamp, not by a hand: then how much it sags tells how stiff it is.
    """
    if model.kind == ObjectKind.ROD:
        return _rod_knobs(model)
    node_mass = model.parameters.total_mass / len(model.graph.positions)
    top_damping = 5.0 if model.kind == ObjectKind.SHEET else 30.0
    # A template of a stiff material is built beyond these bounds; they then move with it.
    room = max(1.0, 3.0 * model.parameters.stiffness / (STIFFEST * node_mass))
    knobs = [
        _springs_knob("stiffness", SpringKind.STRUCTURAL, 1e2 * node_mass, room * STIFFEST * node_mass),
        _number("damping", 0.01 * node_mass, room * top_damping * node_mass, step=0.5, unit="N s/m", logarithmic=True),
        _number("friction", 0.0, 2.0, step=0.05),
        _number(
            "controller_stiffness", 1e2 * node_mass, room * STIFFEST * node_mass, step=0.5, unit="N/m", logarithmic=True
        ),
    ]
    if model.kind == ObjectKind.SHEET:
        bending = _springs_knob("bending stiffness", SpringKind.BENDING, 1.0 * node_mass, 1e5 * node_mass)
        return (*knobs, bending, _number("compression_ratio", 0.05, 1.0, step=0.3, logarithmic=True))
    knobs.append(_number("drag", 0.0, 20.0, step=0.2, unit="1/s"))
    if not clamped:
        # A grip that is soft enough to turn in is too soft to carry: all toys sag too much in their twins. What a toy
        # weighs, how stiff it is and how firmly it is held are one thing there: its sag is evidence for nothing.
        knobs.append(_number("gravity", 0.5 * GRAVITY, 1.2 * GRAVITY, step=0.5, unit="m/s^2"))
    return tuple(knobs)


def _rod_knobs(model: ObjectModel) -> tuple[Knob, ...]:
    """How a rod resists bending, how it is damped and how it is bent by nature; it hardly stretches, and its clamps do
    not give way."""
    length = float(model.graph.rest_lengths.sum())
    # A rod of these rigidities bends under its own weight within 1 % of its length, and within all of it.
    low, high = (model.parameters.total_mass * GRAVITY * share**3 * length**2 for share in (0.01, 1.0))
    longest = longest_retardation(model.parameters.flexural_rigidity, model.graph.rest_lengths, model.node_masses)
    return (
        _number("flexural_rigidity", low, high, step=0.1, unit="N m^2", logarithmic=True),
        _number("retardation_time", min(1e-5, longest / 2.0), longest, step=0.5, unit="s", logarithmic=True),
        _number("drag", 0.0, 20.0, step=0.2, unit="1/s"),
        *(
            _number(name, -2.0 * np.pi / length, 2.0 * np.pi / length, step=BEND_STEP / length, unit="1/m")
            for name in NATURAL_BEND
        ),
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


def _number(name: str, low: float, high: float, *, step: float, unit: str = "1", logarithmic: bool = False) -> Knob:
    def turn(model: ObjectModel, value: float) -> ObjectModel:
        changed: dict[str, Any] = {name: value}
        return replace(model, parameters=replace(model.parameters, **changed))

    return Knob(
        parameter=Parameter(name=name, unit=unit, low=low, high=high, step=step, logarithmic=logarithmic),
        read=lambda model: float(max(getattr(model.parameters, name), low)),
        turn=turn,
    )


def _springs_knob(name: str, kind: SpringKind, low: float, high: float) -> Knob:
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

    return Knob(
        parameter=Parameter(name=name, unit="N/m", low=low, high=high, step=0.3, logarithmic=True),
        read=read,
        turn=turn,
    )
