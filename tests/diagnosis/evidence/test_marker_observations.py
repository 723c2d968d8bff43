"""Objects with a few markers: a synthetic cantilever is placed, followed and recovered."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.diagnosis.evidence.fitted_parameters import with_effect
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.evidence.refit import median_size
from egophys_core.diagnosis.evidence.residuals import block_means, residuals, track_offsets
from egophys_core.diagnosis.hypotheses.ranking import probe_effects
from egophys_core.diagnosis.unidentifiable import unidentifiable_effects
from egophys_core.effects import LIBRARY
from egophys_core.episode import Episode
from egophys_core.kinds.kind import MarkerBody
from egophys_core.kinds.template import parse_template
from egophys_core.twin import ObjectModel
from tests.diagnosis.cantilever import (
    HELD,
    TEMPLATE,
    TRACKS,
    body_and_model,
    ring_down_episode,
    still_episode,
    twin_of,
)
from tests.kinds.seen_markers import marker_body, place_markers


@pytest.fixture(scope="module")
def cantilever() -> tuple[MarkerBody, ObjectModel, Episode]:
    body, model = body_and_model()
    return body, model, ring_down_episode(body, model)


def test_free_rollout_from_the_turn_follows_the_ring_down(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, episode = cantilever
    observation = observe_markers(twin_of(body, model), episode)
    found = block_means(observation, track_offsets(observation, [model])[0])
    extent = np.ptp(episode.points[:, :, 2].mean(axis=1))
    # Bent by its markers it is not quite as gravity bent it, and higher modes are not at rest.
    assert np.nanmax(np.abs(found)) < 0.05 * extent


def test_a_record_mounted_anew_says_as_much_of_the_ring_down(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    """What a turn of the clamp by 0.7 degrees moves is set aside for the most part; a wrong stiffness is not."""
    body, model, episode = cantilever
    turn = Rotation.from_rotvec([0.0, 0.0, 0.012]).as_matrix()
    clamp = body.grasp[len(HELD) + len(TRACKS) :].mean(axis=0)
    turned_record = replace(episode, points=((episode.points - clamp) @ turn.T + clamp).astype(np.float32))
    observation = observe_markers(twin_of(body, model), turned_record)
    offset = np.nanmean(track_offsets(observation, [model])[0], axis=(0, 1, 2))
    stiffer = replace(model, stiffness=model.stiffness * np.float32(1.3))
    true, wrong = ([each] for each in residuals([observation], [model, stiffer])[0])
    assert np.linalg.norm(offset) > 1e-3
    assert median_size(true) < 0.25 * np.linalg.norm(offset)
    assert median_size(wrong) > 2.0 * median_size(true)


def test_what_hands_move_is_not_mounted_anew(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    """A steady offset counts in full, in blocks that are as long as those of what is seen as a surface."""
    body, model, _ = cantilever
    still = still_episode(frames=100)
    hands = still.controllers + np.linspace(0.0, 0.1, 100, dtype=np.float32)[:, None, None]
    found = []
    for shift in (0.0, 0.003):
        points = still.points.copy()
        points[50:] += np.float32(shift)
        observation = observe_markers(twin_of(body, model), replace(still, controllers=hands, points=points))
        assert not observation.mounted
        assert observation.block_count == round(still.times[-1] / 0.2)
        (blocks,) = residuals([observation], [model])[0][:, :, : len(TRACKS)]
        found.append(blocks)
    moved = found[1] - found[0]
    assert moved[:2] == pytest.approx(0.0, abs=1e-5)
    assert moved[3:] == pytest.approx(0.003, abs=1e-5)


def test_slopes_of_effects_on_a_ring_down_are_those_near_none(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    """Material that is stiffer along the beam makes its ring-down faster: where a search for it starts that
    is out of step, and tells nothing of a little of it."""
    body, model, episode = cantilever
    observation = observe_markers(twin_of(body, model), episode)
    [baseline] = residuals([observation], [model])
    others = [name for name in LIBRARY if name != "anisotropy"]
    [probe] = probe_effects([observation], model, [baseline[0]], without=others, progress=lambda share: None)
    there = with_effect(model, "anisotropy", {"cosine": 1e-3, "sine": 0.0})
    fine = (residuals([observation], [there])[0][0] - baseline[0]) / 0.01
    seen = np.isfinite(fine)
    assert np.abs(fine[seen]).max() > 1e-4
    assert probe.slopes[0][..., 0][seen] == pytest.approx(fine[seen], abs=0.25 * np.abs(fine[seen]).max())


def test_a_still_clamp_tells_nothing_of_the_hands(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, episode = cantilever
    observation = observe_markers(twin_of(body, model), episode)
    unidentifiable = unidentifiable_effects(model, [observation])
    assert "tracking_offset" in unidentifiable
    assert "viscoelasticity" not in unidentifiable
    assert observation.rate == 0.0


def test_a_rod_tells_nothing_of_springs_nor_a_record_of_markers_of_a_table(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    body, model, episode = cantilever
    moved = replace(observe_markers(twin_of(body, model), episode), mounted=False)
    of_a_rod, of_a_lattice = (
        set(unidentifiable_effects(replace(model, kind=name), [moved])) for name in ("rod", "lattice")
    )
    assert of_a_lattice == {"added_mass", "table_adhesion", "place_dependent_friction", "stribeck_friction"}
    assert of_a_rod < set(LIBRARY)
    assert "viscoelasticity" in of_a_rod
    assert not {"quadratic_drag", "control_delay", "uneven_mass", "gripper_offset"} & of_a_rod


def test_a_record_begins_where_all_markers_are_seen(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, _ = cantilever
    late = still_episode(frames=100)
    points = late.points.copy()
    points[:5, 0] = np.nan
    late = replace(late, points=points)
    placed = place_markers(model, body.grasp, late)
    assert placed.episode.frames == 95
    assert np.isfinite(placed.episode.points).all()
    assert marker_body(late, parse_template(TEMPLATE)).grasp == pytest.approx(body.grasp)
    observation = observe_markers(twin_of(body, model), late)
    assert observation.observed.record.times[0] == 0.0
