"""Objects, hands and scenes in which effects are tried."""

from dataclasses import replace
from typing import Any

import numpy as np

from egophys_core.effects import LIBRARY, Surroundings, TwinEffect
from egophys_core.effects.effect import Body
from egophys_core.kinds import node_masses
from egophys_core.simulation import BatchEffect, Controls, Rollout, batch_of_models, rollout
from egophys_core.twin import ObjectModel, SpringKind, per_kind
from tests.simulation.scenes import FAR_BELOW, frame_times, idle_controls, scene, sheet_model, sheet_positions
from tests.simulation.substep_path import forces_along, forces_at_start

FRAME, DT = 1 / 30, 1 / 600
"""Seconds of a frame and of a substep."""

G = 9.81


def sheet(**changes: Any) -> ObjectModel:
    """A sheet on the table whose longer springs are bending springs."""
    model = sheet_model(max_neighbours=12, radius=0.11, **changes)
    kinds = np.where(model.graph.rest_lengths > 0.08, SpringKind.BENDING, SpringKind.STRUCTURAL).astype(np.uint8)
    graph = replace(model.graph, kinds=kinds)
    alpha = model.parameters
    return replace(model, graph=graph, stiffness=per_kind(graph, alpha.stiffness, alpha.bending_ratio))


def solid(**changes: Any) -> ObjectModel:
    """Three layers of a grid."""
    layers = [sheet_positions(3, height=height) + [0.002 * height, 0, 0] for height in (0.0, 0.045, 0.09)]
    positions = np.concatenate(layers).astype(np.float32)
    return sheet_model(positions, kind="solid", max_neighbours=10, **changes)


def surroundings(model: ObjectModel) -> Surroundings:
    """Of an object that is lifted by 0.3 m between 1 s and 7 s."""
    rest = model.graph.positions.astype(np.float64)
    return Surroundings(
        rest_positions=rest,
        low=rest.min(axis=0) - 0.05,
        high=rest.max(axis=0) + [0.05, 0.05, 0.3],
        contact_begins=1.0,
        end=7.0,
    )


def with_effect(model: ObjectModel, name: str, **values: float) -> ObjectModel:
    """The object with one more effect."""
    return replace(model, effects=(*model.effects, TwinEffect(name=name, values=values)))


def lifted(duration: float = 0.5, height: float = 0.1) -> Controls:
    """A hand of three points that takes a corner of the sheet and lifts it."""
    times = frame_times(duration, FRAME)
    points = np.array([[0.07, 0.07, 0.0], [0.05, 0.08, 0.005], [0.08, 0.05, 0.01]])
    path = np.tile(points, (len(times), 1, 1))
    path[:, :, 2] += (height * times / duration)[:, None]
    return Controls(times=times, positions=path.astype(np.float32), contact=np.ones(path.shape[:2], np.uint8))


def run(
    model: ObjectModel,
    controls: Controls | None = None,
    *,
    duration: float = 0.5,
    ground_height: float = FAR_BELOW,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Rollout:
    """The rollout of one object from rest, or thrown; free unless a hand is given."""
    controls = controls or idle_controls(frame_times(duration, FRAME))
    batch = batch_of_models([model], [controls], ground_height=ground_height)
    result = rollout(replace(batch, velocities=batch.velocities + np.float32(velocity)))
    result.raise_on_failure()
    return result


def centre_path(result: Rollout) -> np.ndarray:
    """[F, 3] metres: the mean of the nodes of the only rollout."""
    return result.positions[0].astype(np.float64).mean(axis=1)


def body_at(positions: Any, **changes: Any) -> Body:
    """Free nodes at rest of 1 kg each, with no springs."""
    nodes = np.asarray(positions, float)
    known: dict[str, Any] = {
        "rest_positions": nodes,
        "masses": np.ones(len(nodes)),
        "springs": np.zeros((0, 2), int),
        "bending": np.zeros(0, bool),
        "stiffness": np.zeros(0),
        "damping": np.zeros(0),
        "gravity": G,
        "begins": 0.0,
    }
    return Body(positions=nodes, **{**known, **changes})


def accelerations(
    name: str, values: dict[str, float], positions: Any, *, velocities: Any = None, start: Any = None, dt: float = DT
) -> np.ndarray:
    """[N, 3] m/s^2 of an effect on free nodes of 1 kg that began at rest at `start`, in a substep of `dt`."""
    force = LIBRARY[name].node_force
    assert force is not None
    body = body_at(positions if start is None else start)
    effect = BatchEffect(
        effect=LIBRARY[name], numbers=force.numbers(values, body)[None].astype(np.float32), present=np.ones(1, bool)
    )
    batch = scene(positions, idle_controls(np.array([0.0, dt])), velocities=velocities, ground_height=0.0, gravity=G)
    quiet = [forces_at_start(replace(batch, effects=effects))[0] for effects in ((effect,), ())]
    return np.asarray(quiet[0] - quiet[1], np.float64)


def relative_forces(name: str, values: dict[str, float], strains: Any, *, dt: float = DT) -> np.ndarray:
    """F / (k l0) of one spring that is held at a strain after the other, for a substep each."""
    law = LIBRARY[name].spring_law
    assert law is not None
    numbers = np.zeros((1, 4), np.float32)
    known = law.numbers(values, body_at([[0, 0, 0], [0.1, 0, 0]]))
    numbers[0, : len(known)] = known
    effect = BatchEffect(effect=LIBRARY[name], numbers=numbers, present=np.ones(1, bool))
    batch = scene(
        [[0, 0, 0], [0.1, 0, 0]],
        idle_controls(np.array([0.0, 2 * dt])),
        springs=[(0, 1)],
        rest_lengths=[0.1],
        stiffness=10.0,
    )
    lengths = 0.1 * (1.0 + np.asarray(strains, float))
    places = np.zeros((len(lengths), 2, 3))
    places[:, 1, 0] = lengths
    return forces_along(replace(batch, effects=(effect,)), places)[:, 0, 0] / (10.0 * 0.1)


def body_of(model: ObjectModel) -> Body:
    """An object's nodes and springs before a rollout."""
    rest = model.graph.positions.astype(np.float64)
    return Body(
        positions=rest,
        rest_positions=rest,
        masses=node_masses(model).astype(np.float64),
        springs=model.graph.springs,
        bending=model.graph.kinds == SpringKind.BENDING,
        stiffness=model.stiffness.astype(np.float64),
        damping=model.spring_damping.astype(np.float64),
        gravity=model.parameters.gravity,
        begins=0.0,
    )


def adapted(model: ObjectModel, name: str, **values: float) -> Body:
    """The body as an effect makes it."""
    adapt = LIBRARY[name].adapt
    assert adapt is not None
    return adapt(values, body_of(model))
