"""From object models and controls to the batch that is rolled out."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from egophys_core.effects import TwinEffect, effect_named
from egophys_core.effects.effect import Body, Effect
from egophys_core.errors import SimulationError
from egophys_core.kinds import kind_of, node_masses, resting_height
from egophys_core.simulation.batch import BatchCodebook, BatchEffect, Rods, RolloutBatch, Slide
from egophys_core.simulation.controls import ContactKind, Controls
from egophys_core.simulation.frames import into_world, into_world_directions
from egophys_core.simulation.terms.effects import LAW_NUMBERS
from egophys_core.simulation.terms.rod_bending import rod_bending
from egophys_core.simulation.terms.springs import UNLIMITED
from egophys_core.twin import ObjectModel, PhysicalParameters, SpringKind, static_features
from egophys_core.twin.spring_features import STATIC

Precision = type[np.float32] | type[np.float64]
"""Of a batch's arrays."""

SAME_PLACE = 1e-4
"""Metres between a node and the controller point that holds it."""


def batch_of_models(
    models: Sequence[ObjectModel],
    controls: Sequence[Controls],
    *,
    starts: Sequence[np.ndarray] | None = None,
    velocities: Sequence[np.ndarray | None] | None = None,
    ground_height: float,
    dtype: Precision = np.float32,
) -> RolloutBatch:
    """Rollouts of models with the same nodes (graphs and parameters may differ), one control each.

    Args:
        starts: per model [N, 3] metres where its nodes lie at the start; by default the graph's own positions.
        velocities: per model [N, 3] m/s there; by default, and where None, it is at rest.
        dtype: of the arrays; np.float64 for differences of batches, which are not simulated themselves.
    """
    first = models[0]
    nodes, kind = len(first.graph.positions), kind_of(first)
    for model in models:
        kind.require_graph(model.graph)
        if len(model.graph.positions) != nodes or kind_of(model) is not kind:
            raise SimulationError("a batch needs models of one object: the same kind and number of nodes")
    positions = [model.graph.positions for model in models] if starts is None else list(starts)
    at_rest = np.zeros((nodes, 3))
    speeds = [at_rest if each is None else each for each in velocities or [None] * len(models)]
    frames = None
    if any(effect_named(term.name).frame for model in models for term in model.effects):
        frames = np.stack([_frame(model) for model in models])
        positions = [into_world(start, frame) for start, frame in zip(positions, frames, strict=True)]
        speeds = list(into_world_directions(np.stack(speeds), frames))
        controls = [
            replace(each, positions=into_world(each.positions.astype(np.float64), frame).astype(dtype))
            for each, frame in zip(controls, frames, strict=True)
        ]
    bodies = [_body(*each) for each in zip(models, positions, controls, strict=True)]
    codes = [_codes(model) for model in models]
    # A pair can be a structural spring of one model and a bending spring of another: one entry serves both.
    union = np.unique(np.concatenate(codes))
    shape = (len(models), len(union))
    stiffness, damping = np.zeros(shape, dtype), np.zeros(shape, dtype)
    rest_lengths, longest_extensions = np.ones(shape, dtype), np.full(shape, UNLIMITED, dtype)
    for row, (model, body, code) in enumerate(zip(models, bodies, codes, strict=True)):
        columns = np.searchsorted(union, code)
        stiffness[row, columns] = body.stiffness
        damping[row, columns] = body.damping
        rest_lengths[row, columns] = model.graph.rest_lengths
        structural = model.graph.kinds == SpringKind.STRUCTURAL
        longest_extensions[row, columns[structural]] = (
            model.parameters.strain_limit * model.graph.rest_lengths[structural]
        )
    masses = np.stack([body.masses for body in bodies]).astype(dtype)
    parameters = tuple(
        replace(model.parameters, gravity=body.gravity, added_mass=body.added_mass)
        for model, body in zip(models, bodies, strict=True)
    )
    return RolloutBatch(
        springs=np.stack([union // nodes, union % nodes], axis=1).astype(np.int32),
        stiffness=stiffness,
        damping=damping,
        rest_lengths=rest_lengths,
        longest_extensions=longest_extensions,
        masses=masses,
        positions=np.stack(positions).astype(dtype),
        velocities=np.stack(speeds).astype(dtype),
        rest_positions=first.graph.positions,
        parameters=parameters,
        controls=tuple(as_they_were(each, model.effects, dtype) for model, each in zip(models, controls, strict=True)),
        effects=_in_every_substep(models, bodies, dtype),
        slides=_slides(models),
        across=_across(first, parameters),
        codebook=_codebook(models, codes, union),
        rods=_bending(models, masses, np.stack(positions), controls, frames),
        flat=kind.lies_flat,
        ground_height=ground_height,
        frames=frames,
    )


def _in_every_substep(
    models: Sequence[ObjectModel], bodies: Sequence[Body], dtype: Precision
) -> tuple[BatchEffect, ...]:
    """The effects of models that act in every substep, in the order in which they are first met."""
    found: dict[str, dict[int, np.ndarray]] = {}
    for row, (model, body) in enumerate(zip(models, bodies, strict=True)):
        for term in model.effects:
            acts = effect_named(term.name).node_force or effect_named(term.name).spring_law
            if acts:
                found.setdefault(term.name, {})[row] = acts.numbers(term.values, body)
    return tuple(_of_batch(effect_named(name), rows, len(models), dtype) for name, rows in found.items())


def _slides(models: Sequence[ObjectModel]) -> tuple[tuple[Slide, ...], ...] | None:
    """How grips of each model slip; None where none does."""
    found = tuple(
        tuple(partial(slide, term.values) for term in model.effects if (slide := effect_named(term.name).slide))
        for model in models
    )
    return found if any(found) else None


def _of_batch(effect: Effect, rows: dict[int, np.ndarray], count: int, dtype: Precision) -> BatchEffect:
    """An effect with its numbers in some rows of a batch; those of a spring law have room for all that it may have."""
    width = LAW_NUMBERS if effect.spring_law else len(next(iter(rows.values())))
    numbers, present = np.zeros((count, width), dtype), np.zeros(count, bool)
    for row, values in rows.items():
        numbers[row, : len(values)], present[row] = values, True
    return BatchEffect(effect=effect, numbers=numbers, present=present)


def _codebook(models: Sequence[ObjectModel], codes: Sequence[np.ndarray], union: np.ndarray) -> BatchCodebook | None:
    """The codebook of models whose springs have these codes, in a batch of the springs `union`; None if none has one.

    Raises:
        SimulationError: two models have different codebooks.
    """
    found = [model.codebook for model in models if model.codebook is not None]
    if not found:
        return None
    if not all(found[0].same_as(other) for other in found):
        raise SimulationError("a batch can hold one codebook; roll out models with different ones apart")
    features = np.zeros((len(models), len(union), len(STATIC)), np.float32)
    of_graph: dict[int, np.ndarray] = {}
    for row, (model, code) in enumerate(zip(models, codes, strict=True)):
        if model.codebook is not None:
            graph = model.graph
            if id(graph) not in of_graph:
                of_graph[id(graph)] = static_features(graph)
            features[row, np.searchsorted(union, code)] = of_graph[id(graph)]
    used = np.array([model.codebook is not None for model in models])
    return BatchCodebook(codebook=found[0], features=features, used=used)


def _bending(
    models: Sequence[ObjectModel],
    masses: np.ndarray,
    starts: np.ndarray,
    controls: Sequence[Controls],
    frames: np.ndarray | None,
) -> Rods | None:
    """What rods of masses [K, N] kg that begin at starts [K, N, 3], metres, resist besides being stretched.

    Args:
        frames: [K, 4, 4] of their records; None where all are the world.
    """
    if not kind_of(models[0]).is_line:
        return None
    lengths = np.stack([model.graph.rest_lengths for model in models])
    far_clamps = [_holds(each, start[-1]) for each, start in zip(controls, starts, strict=True)]
    straight = np.stack([model.graph.positions[-1] - model.graph.positions[0] for model in models]).astype(np.float64)
    alike = np.zeros((masses.shape[1], 2))
    return rod_bending(
        [model.parameters for model in models],
        lengths,
        masses,
        straight if frames is None else into_world_directions(straight[:, None], frames)[:, 0],
        np.array(far_clamps),
        np.stack([alike if each.intrinsic_curvature is None else each.intrinsic_curvature for each in models]),
    )


def _across(model: ObjectModel, parameters: Sequence[PhysicalParameters]) -> np.ndarray:
    """[N, 4] int32: the nodes across each node of a thin object; [0, 4] where none of the rollouts carries air."""
    across = kind_of(model).across
    if across is None or not any(each.added_mass for each in parameters):
        return np.zeros((0, 4), np.int32)
    return across(model.graph.positions)


def _holds(controls: Controls, place: np.ndarray) -> bool:
    """Whether a controller point holds a place [3], metres, from the start on."""
    holding = controls.positions[0, controls.contact[0] == ContactKind.HOLD]
    return bool((np.linalg.norm(holding - place, axis=1) < SAME_PLACE).any())


def _body(model: ObjectModel, start: np.ndarray, controls: Controls) -> Body:
    """The body of a model as its effects make it, with what it carries.

    What a payload takes off nodes is part of the object, which effects change; what it adds is not.

    Raises:
        SimulationError: nothing would be left of a node.
    """
    graph = model.graph
    masses = node_masses(model).astype(np.float64)
    payload = np.zeros_like(masses) if controls.payload is None else controls.payload
    masses = masses + np.minimum(payload, 0.0)
    if not (masses > 0.0).all():
        node = int(np.argmin(masses))
        raise SimulationError(f"controls payload leaves {masses[node]:.3g} kg of node {node}; it must be more than 0")
    body = Body(
        positions=start.astype(np.float64),
        rest_positions=graph.positions.astype(np.float64),
        masses=masses,
        springs=graph.springs,
        bending=graph.kinds == SpringKind.BENDING,
        stiffness=model.stiffness.astype(np.float64),
        damping=model.spring_damping.astype(np.float64),
        gravity=model.parameters.gravity,
        added_mass=model.parameters.added_mass,
        begins=float(controls.times[0]),
    )
    for term in model.effects:
        adapt = effect_named(term.name).adapt
        body = adapt(term.values, body) if adapt else body
    return replace(body, masses=body.masses + np.maximum(payload, 0.0))


def _frame(model: ObjectModel) -> np.ndarray:
    """[4, 4] the frame of a model's record, in which the object touches the table where it does in the world."""
    turns = (effect_named(term.name).frame for term in model.effects)
    turned = [turn(term.values) for turn, term in zip(turns, model.effects, strict=True) if turn]
    frame = np.eye(4)
    if turned:
        frame[:3, :3] = turned[0]
        rest = model.graph.positions.astype(np.float64)
        rise = resting_height(model, rest) - resting_height(model, into_world(rest, frame))
        frame[:3, 3] = -rise * frame[:3, 2]
    return frame


def as_they_were(controls: Controls, effects: Sequence[TwinEffect], dtype: Precision = np.float32) -> Controls:
    """Controls as effects change them: where, and when, the hands truly were."""
    for term in effects:
        effect = effect_named(term.name)
        if effect.clock:
            controls = _read_at(controls, effect.clock(term.values, controls.times), dtype)
        if effect.drive:
            holds = controls.contact == ContactKind.HOLD
            moved = effect.drive(term.values, controls.times, controls.positions.astype(np.float64), holds)
            controls = replace(controls, positions=moved.astype(dtype))
    return controls


def _read_at(controls: Controls, times: np.ndarray, dtype: Precision) -> Controls:
    """The same frames with hands and contacts as the record has them at `times` [F]; held at its ends."""
    record = np.clip(times, controls.times[0], controls.times[-1])
    after = np.clip(np.searchsorted(controls.times, record, side="right"), 1, len(record) - 1)
    before = after - 1
    share = (record - controls.times[before]) / (controls.times[after] - controls.times[before])
    weight = share[:, None, None]
    positions = (1.0 - weight) * controls.positions[before] + weight * controls.positions[after]
    nearest = np.where(share < 0.5, before, after)
    return replace(controls, positions=positions.astype(dtype), contact=controls.contact[nearest])


def spring_order(model: ObjectModel) -> np.ndarray:
    """[E] where each spring of a model stands in `batch_of_models([model], ...)`."""
    return np.argsort(np.argsort(_codes(model)))


def _codes(model: ObjectModel) -> np.ndarray:
    """One number per spring that names its pair of nodes; sorted, they order springs by their first node."""
    return model.graph.springs[:, 0].astype(np.int64) * len(model.graph.positions) + model.graph.springs[:, 1]
