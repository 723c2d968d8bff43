"""Stiffness by a codebook in rollouts, against the float64 reference and against what it must not change."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.simulation import Controls, batch_of_models, rollout, spring_order
from egophys_core.simulation.engine import Engine
from egophys_core.twin import ObjectModel, static_features
from tests.reference.codebook import dynamic_of, factors
from tests.simulation.scenes import frame_times, sheet_model, sheet_positions
from tests.twin.codebooks import plain_codebook, random_codebook

TIMES = frame_times(0.2, 0.02)


def lifted(model: ObjectModel) -> Controls:
    """One point that holds a corner and moves up, and one that takes hold of another corner midway."""
    corners = model.graph.positions[[0, -1]].astype(np.float64)
    path = corners[None] + TIMES[:, None, None] * np.array([[0.1, 0.2, 0.6], [-0.2, 0.0, 0.3]])
    path[:, 1] += corners[1] - path[5, 1]
    contact = np.ones((len(TIMES), 2), bool)
    contact[:5, 1] = False
    return Controls(times=TIMES, positions=path.astype(np.float32), contact=contact)


def soft_sheet(side: int = 4) -> ObjectModel:
    """A sheet near the table."""
    model = sheet_model(sheet_positions(side))
    quick = replace(
        model.parameters, gravity=9.81, contact_radius=0.002, controller_radius=0.01, controller_neighbours=1
    )
    return replace(model, parameters=quick)


@pytest.mark.parametrize("prototypes", [0, 1, 4, 7])
def test_stiffness_of_every_frame_agrees_with_the_reference(prototypes):
    model = replace(soft_sheet(), codebook=random_codebook(prototypes))
    batch = batch_of_models([model], [lifted(model)], ground_height=0.01)
    engine, order = Engine(batch, "cpu"), spring_order(model)
    seen = []
    for frame in range(len(TIMES) - 1):
        positions, velocities = engine.node_positions()[0].copy(), engine.node_velocities()[0].copy()
        engine.advance_frame(frame)
        held = np.zeros(len(positions))
        held[engine.segments[-1].attachments[0].nodes] = 1.0
        dynamic = dynamic_of(positions, velocities, held, model.graph.springs, model.graph.rest_lengths, 0.012)
        expected = model.stiffness * factors(model.codebook, static_features(model.graph), dynamic)
        found = engine.springs.stiffness.numpy()[0, order, 0]
        # At its rest length a spring may be counted to either bank.
        told = np.abs(dynamic[:, 0]) > 1e-6
        assert found[told] == pytest.approx(expected[told], rel=2e-4)
        seen.append(found)
    assert np.ptp(seen, axis=0).max() > 0.02 * model.stiffness.max()


def test_a_codebook_of_nothing_changes_nothing():
    model = soft_sheet()
    still = replace(model, codebook=plain_codebook(prototypes=[[0.0], [0.0]], slope=1.0))
    plain, same = (rollout(batch_of_models([each], [lifted(each)], ground_height=0.0)) for each in (model, still))
    assert np.array_equal(plain.positions, same.positions)


def test_a_codebook_of_one_offset_is_a_stiffer_object():
    model = soft_sheet()
    learned = replace(model, codebook=plain_codebook(prototypes=[[0.5], [0.5]], slope=0.0))
    stiffer = replace(model, stiffness=(model.stiffness * np.exp(0.5)).astype(np.float32))
    by_codebook, by_hand = (
        rollout(batch_of_models([each], [lifted(each)], ground_height=0.0), longest_substep=1e-3)
        for each in (learned, stiffer)
    )
    assert by_codebook.positions == pytest.approx(by_hand.positions, abs=2e-5)


def test_rollouts_do_not_depend_on_the_batch_they_are_in():
    # Other graphs, and one without the codebook, in the same lane group.
    codebook = random_codebook()
    models = [soft_sheet(), replace(soft_sheet(), codebook=codebook)]
    fewer = models[1].graph
    kept = np.arange(len(fewer.springs)) % 7 != 3
    graph = replace(fewer, springs=fewer.springs[kept], kinds=fewer.kinds[kept], rest_lengths=fewer.rest_lengths[kept])
    models.append(replace(models[1], graph=graph, stiffness=models[1].stiffness[kept]))
    together = rollout(batch_of_models(models, [lifted(models[0])] * 3, ground_height=0.0))
    for row, model in enumerate(models):
        alone = rollout(batch_of_models([model], [lifted(model)], ground_height=0.0))
        assert together.positions[row] == pytest.approx(alone.positions[0], abs=1e-6)
    assert np.abs(together.positions[0] - together.positions[1]).max() > 1e-4


def test_substeps_cover_the_stiffest_spring_of_the_frame():
    model = replace(soft_sheet(), stiffness=np.full_like(soft_sheet().stiffness, 2000.0))
    learned = replace(model, codebook=plain_codebook(prototypes=[[np.log(3.0)], [np.log(2.0)]], slope=1.0))
    plain, more = (
        rollout(batch_of_models([each], [lifted(each)], ground_height=0.0)).substeps[0] for each in (model, learned)
    )
    assert more == pytest.approx(np.sqrt(3.0) * plain, rel=0.05)


def test_two_codebooks_cannot_be_in_one_batch():
    models = [replace(soft_sheet(), codebook=random_codebook(seed=seed)) for seed in (0, 1)]
    with pytest.raises(SimulationError, match="one codebook"):
        batch_of_models(models, [lifted(models[0])] * 2, ground_height=0.0)
