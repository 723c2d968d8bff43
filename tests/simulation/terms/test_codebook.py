"""Stiffness by a codebook in rollouts, against the float64 reference and against what it must not change."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.simulation import Controls, batch_of_models, rollout, spring_order
from egophys_core.simulation.codebook_arrays import asked_frames
from egophys_core.simulation.engine import Engine
from egophys_core.simulation.gradients import differentiate
from egophys_core.twin import ObjectModel, static_features
from tests.reference.codebook import dynamic_of, factors
from tests.simulation.differences import linear_loss
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
def test_stiffness_agrees_with_the_reference_in_the_frame_that_asks(prototypes):
    model = replace(soft_sheet(), codebook=random_codebook(prototypes))
    batch = batch_of_models([model], [lifted(model)], ground_height=0.01)
    engine, order = Engine(batch, "cpu"), spring_order(model)
    seen = []
    for frame in range(len(TIMES) - 1):
        positions, velocities = engine.node_positions()[0].copy(), engine.node_velocities()[0].copy()
        engine.advance_frame(frame)
        held = np.zeros(len(positions))
        held[engine.segments[-1].attachments[0].nodes] = 1.0
        if frame % 3 == 0:
            # Three frames of 20 ms are one question's worth.
            dynamic = dynamic_of(positions, velocities, held, model.graph.springs, model.graph.rest_lengths, 0.012)
            expected = model.stiffness * factors(model.codebook, static_features(model.graph), dynamic)
            # At its rest length a spring may be counted to either bank.
            told = np.abs(dynamic[:, 0]) > 1e-6
        found = engine.springs.stiffness.numpy()[0, order, 0]
        assert found[told] == pytest.approx(expected[told], rel=2e-4)
        seen.append(found)
    assert np.ptp(seen, axis=0).max() > 0.02 * model.stiffness.max()


def test_stiffness_is_held_for_two_frames_of_a_video_and_for_none_of_a_slow_one():
    at_30_hz = np.round(np.arange(8) / 30.0, 2)
    assert asked_frames(at_30_hz, 0.07).tolist() == [0, 0, 2, 2, 4, 4, 6]
    assert asked_frames(np.arange(5) / 10.0, 0.07).tolist() == [0, 1, 2, 3]
    with_a_gap = np.array([0.0, 0.03, 0.3, 0.33, 0.36])
    assert asked_frames(with_a_gap, 0.07).tolist() == [0, 1, 2, 2]


@pytest.mark.parametrize(("windows", "questions"), [(1, 4), (4, 7)])
def test_every_frame_of_every_window_is_gone_back_over_once(windows, questions):
    # What is passed on to the codebook's weights is, all together, the derivative by the anchors, times the factor.
    model = replace(soft_sheet(), codebook=plain_codebook(prototypes=[[0.5], [0.5]], slope=0.0))
    batch = batch_of_models([model], [lifted(model)], ground_height=-10.0)
    weights = np.random.default_rng(3).normal(0.0, 1.0, (len(TIMES), *batch.positions.shape[1:]))
    passed, rows = np.zeros(len(batch.springs)), []

    def through(positions, velocities, held, by_stiffness):
        passed[:] += by_stiffness.sum(axis=0)
        rows.append(len(positions))
        return np.zeros_like(positions), np.zeros_like(velocities)

    _, _, gradient = differentiate(batch, linear_loss(weights), windows=windows, through_codebook=through)
    assert np.abs(gradient.stiffness[0]).max() > 0.0
    assert np.exp(0.5) * passed == pytest.approx(gradient.stiffness[0], rel=1e-5, abs=1e-12)
    # The codebook is asked at 0, 3, 6 and 9; the windows that begin at 2, 5 and 7 begin between questions.
    assert sum(rows) == questions


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
