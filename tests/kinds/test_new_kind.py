"""A kind that the package does not know: one file and one line, and all that is done with objects is done with it.

The kind is a rubber ring on a table: a closed line of nodes, each linked to the next, and to the next but one by a
spring that bends. It is longer where its nodes are farther apart, and weighs more there.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters
from egophys_core.diagnosis.evidence.refit import refit
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.identification import FitOptions, build, evaluate_twin, predict
from egophys_core.kinds import KINDS, Kind, kind_of, node_masses, resting_height
from egophys_core.kinds.kind import FittedParameter, FromSurface, RestShape, Searched
from egophys_core.kinds.rest_shape import recognised
from egophys_core.kinds.spring_body import fitted
from egophys_core.observation import observe_episode, place_twin
from egophys_core.twin import (
    ObjectModel,
    PhysicalParameters,
    SpringGraph,
    SpringKind,
    Twin,
    load_twin,
    per_kind,
    save_twin,
)
from tests.identification.synthetic import make_episode

# --- the file of the kind ---

MASS = 0.02
"""kg."""


def around(positions: np.ndarray) -> np.ndarray:
    """[N] the nodes in their order around the middle."""
    beside = positions - positions.mean(axis=0)
    return np.argsort(np.arctan2(beside[:, 1], beside[:, 0]))


def is_ring(points: np.ndarray) -> bool:
    """Whether points lie as far from the middle of their box as each other."""
    away = np.linalg.norm(points - (points.min(axis=0) + points.max(axis=0)) / 2.0, axis=1)
    return bool(away.std() < 0.1 * away.mean())


def ring_graph(shape: RestShape) -> SpringGraph:
    order = around(shape.positions)
    pairs = [np.sort(np.stack([order, np.roll(order, -step)], axis=1), axis=1) for step in (1, 2)]
    springs = np.concatenate(pairs).astype(np.int32)
    ends = shape.positions[springs].astype(np.float64)
    return SpringGraph(
        positions=shape.positions,
        springs=springs,
        kinds=np.repeat(np.array([SpringKind.STRUCTURAL, SpringKind.BENDING], np.uint8), len(order)),
        rest_lengths=np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).astype(np.float32),
        surface=shape.surface,
    )


def ring_model(shape: RestShape, value: Mapping[str, float], ground_height: float) -> ObjectModel:
    graph, node_mass = ring_graph(shape), MASS / len(shape.positions)
    alpha = PhysicalParameters(
        total_mass=MASS,
        stiffness=value["stiffness_rate"] * node_mass,
        damping=0.5 * node_mass,
        bending_ratio=value["bending_ratio"],
        controller_stiffness=value["stiffness_rate"] * node_mass,
        controller_radius=2.0 * shape.spacing,
        contact_radius=max(0.0, float(np.median(shape.positions[:, 2])) - ground_height),
    )
    return ObjectModel(
        kind=shape.kind, graph=graph, parameters=alpha, stiffness=per_kind(graph, alpha.stiffness, alpha.bending_ratio)
    )


def masses_around(graph: SpringGraph, total: float) -> np.ndarray:
    half = np.bincount(
        graph.springs[graph.kinds == SpringKind.STRUCTURAL].ravel(),
        np.repeat(graph.rest_lengths[graph.kinds == SpringKind.STRUCTURAL], 2),
    )
    return (total * half / half.sum()).astype(np.float32)


def fitted_of_ring(model: ObjectModel) -> tuple[FittedParameter, ...]:
    return (fitted("drag", 0.0, 20.0, 0.2, unit="1/s"), fitted("friction", 0.0, 2.0, 0.05))


RING = Kind(
    name="ring",
    from_surface=FromSurface(
        recognises=is_ring,
        searched=(
            Searched(name="stiffness_rate", low=1e3, high=1e5, start=1e4, logarithmic=True),
            Searched(name="bending_ratio", low=1e-2, high=1.0, start=0.1, logarithmic=True),
        ),
        model=ring_model,
    ),
    node_masses=masses_around,
    resting_height=lambda positions: float(np.median(positions[:, 2])),
    lies_flat=True,
    fitted=fitted_of_ring,
    faces=lambda graph: np.zeros((0, 3), np.int32),
)


# --- its line in the list, and what is done with it ---


@pytest.fixture(autouse=True, scope="module")
def listed() -> Iterator[None]:
    """The kind before the others, as a ring lies flat and would be a sheet."""
    others = dict(KINDS)
    KINDS.clear()
    KINDS.update({RING.name: RING, **others})
    yield
    KINDS.clear()
    KINDS.update(others)


def ring_shape(count: int = 28) -> RestShape:
    # Nodes stand nearer to each other on one side.
    angles = 2.0 * np.pi * np.arange(count) / count
    angles = angles + 0.3 * np.sin(angles)
    positions = np.stack([0.08 * np.cos(angles), 0.08 * np.sin(angles), np.full(count, 0.006)], axis=1)
    return RestShape(positions=positions.astype(np.float32), surface=np.ones(count, bool), kind="ring", spacing=0.03)


TRUTH = {"stiffness_rate": 4e4, "bending_ratio": 0.3}
FIT = FitOptions(generations=12, population=8, frame_stride=4, dense_steps=1)


@pytest.fixture(scope="module")
def built(listed: None) -> Twin:
    return build([make_episode(ring_model(ring_shape(), TRUTH, 0.0))], FIT)


def test_it_is_known_when_it_is_seen_and_built(built: Twin) -> None:
    assert recognised(ring_shape().positions) is RING
    assert built.model.kind == "ring"
    assert kind_of(built.model) is RING
    assert built.model.parameters.total_mass == MASS
    assert built.provenance.scores["test_track_m"] < 0.01


def test_its_masses_and_height_are_asked_of_it(built: Twin) -> None:
    masses = node_masses(built.model)
    assert masses.sum() == pytest.approx(MASS)
    assert masses.max() > 1.5 * masses.min()
    assert resting_height(built.model, built.model.graph.positions) == pytest.approx(0.006, abs=1e-3)


def test_its_file_holds_it_to_the_bit(built: Twin, tmp_path: Path) -> None:
    save_twin(built, tmp_path / "ring.twin")
    read = load_twin(tmp_path / "ring.twin")
    assert read.twin_id == built.twin_id
    assert kind_of(read.model) is RING
    episode = make_episode(ring_model(ring_shape(), TRUTH, 0.0))
    places = [predict(each.model, place_twin(each, episode)) for each in (built, read)]
    assert np.array_equal(*places)


def test_it_has_its_place_in_another_episode(built: Twin) -> None:
    """Where it lies turned, and is carried elsewhere."""
    truth = ring_model(ring_shape(), TRUTH, 0.0)
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    there = (truth.graph.positions @ turn.T + [0.1, -0.05, 0.0]).astype(np.float32)
    other = make_episode(truth, start=there, carry=(-0.05, 0.06, 0.1), name="other")
    assert observe_episode(other).touched > 0
    scores, _ = evaluate_twin(built, other)
    assert scores.all_track_m < 0.015


def test_its_own_parameters_are_fitted_anew(built: Twin) -> None:
    dragged = ring_model(ring_shape(), TRUTH, 0.0)
    dragged = replace(dragged, parameters=replace(dragged.parameters, drag=2.0))
    observations = [observe(built.model, make_episode(dragged))]
    parameters = baseline_parameters(built.model)
    assert [each.definition.name for each in parameters] == ["drag", "friction"]
    before = refit(observations, built.model, parameters, iterations=0)
    after = refit(observations, built.model, parameters, iterations=4)
    assert after.loss < before.loss
    assert after.model.parameters.drag > 0.5
