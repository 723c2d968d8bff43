"""Records in a frame that is turned against the world: simulated upright, given back as they were recorded."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.effects import TwinEffect
from egophys_core.effects.rotations import rotation
from egophys_core.errors import SimulationError
from egophys_core.kinds.sheet import resting_height
from egophys_core.simulation import Controls, batch_of_models, rollout
from egophys_core.twin import ObjectModel
from tests.simulation.scenes import frame_times, idle_controls, sheet_model, sheet_positions

HEIGHT = 0.004
"""Metres above the table at which the sheet lies."""

TILTS = [(0.2, 0.0), (0.15, -0.1), (0.0, -0.3), (0.02, 0.03)]
"""Radians about x and y."""


def tilted(points: np.ndarray, tilt: tuple[float, float]) -> np.ndarray:
    """Points [..., 3] of the world as a frame tilted by (about_x, about_y) records them."""
    return points @ rotation(np.array([*tilt, 0.0])).T


def flat_sheet() -> np.ndarray:
    """[N, 3] metres, level, away from the origin on the side that each of `TILTS` lifts above the table."""
    return sheet_positions(4, height=HEIGHT).astype(np.float64) + [0.15, 0.25, 0.0]


def sheet_at(positions: np.ndarray, tilt: tuple[float, float] | None = None) -> ObjectModel:
    """A sheet with these nodes, with the effect of a tilted record or without."""
    if tilt is None:
        return sheet_model(positions.astype(np.float32), contact_radius=HEIGHT)
    # As a twin is identified: it rests at the height at which its record has it.
    model = sheet_model(positions.astype(np.float32), contact_radius=max(0.0, resting_height(positions)))
    values = {"about_x": tilt[0], "about_y": tilt[1]}
    return replace(model, effects=(TwinEffect(name="tracking_rotation", values=values),))


def lifting_hand() -> Controls:
    """Two points at a corner of the flat sheet that lift it, carry it off and drop it."""
    times = frame_times(0.7, 1 / 30)
    corner = flat_sheet().max(axis=0)
    path = corner + np.array([[0.0, 0.0, 0.005], [-0.02, 0.0, 0.005]]) + times[:, None, None] * [0.1, -0.05, 0.2]
    contact = np.repeat((times < 0.4)[:, None], 2, axis=1)
    return Controls(times=times, positions=path.astype(np.float32), contact=contact.astype(np.uint8))


def recorded(controls: Controls, tilt: tuple[float, float]) -> Controls:
    """The same hands as a tilted frame records them."""
    return replace(controls, positions=tilted(controls.positions, tilt).astype(np.float32))


def run(models: list[ObjectModel], controls: list[Controls], **options):
    result = rollout(batch_of_models(models, controls, ground_height=0.0, **options))
    result.raise_on_failure()
    return result


@pytest.mark.parametrize("tilt", TILTS)
def test_what_lies_on_a_table_recorded_tilted_lies_still(tilt):
    record = tilted(flat_sheet(), tilt)
    still = run([sheet_at(record, tilt)], [idle_controls(frame_times(0.5, 1 / 30))])
    assert np.abs(still.positions[0] - record).max() < 1e-5
    assert np.abs(still.velocities).max() < 1e-3


def test_without_the_effect_it_falls_flat():
    record = tilted(flat_sheet(), TILTS[0])
    fallen = run([sheet_at(record)], [idle_controls(frame_times(0.5, 1 / 30))]).positions[0, -1]
    assert np.ptp(record[:, 2]) > 0.02
    assert fallen[:, 2] == pytest.approx(HEIGHT, abs=1e-3)


@pytest.mark.parametrize("tilt", TILTS)
def test_a_lift_recorded_tilted_is_the_lift_tilted(tilt):
    level = run([sheet_at(flat_sheet())], [lifting_hand()])
    turned = run([sheet_at(tilted(flat_sheet(), tilt), tilt)], [recorded(lifting_hand(), tilt)])
    assert np.ptp(level.positions[0, :, :, 2], axis=0).max() > 0.05
    assert turned.positions[0] == pytest.approx(tilted(level.positions[0], tilt), abs=1e-4)
    assert turned.velocities[0] == pytest.approx(tilted(level.velocities[0], tilt), abs=1e-2)


def test_places_of_other_episodes_are_turned_too():
    tilt = TILTS[1]
    elsewhere = flat_sheet() + [0.05, -0.04, 0.0]
    idle = idle_controls(frame_times(0.3, 1 / 30))
    start = tilted(elsewhere, tilt).astype(np.float32)
    moved = run([sheet_at(tilted(flat_sheet(), tilt), tilt)], [idle], starts=[start])
    assert np.abs(moved.positions[0] - start).max() < 1e-5


def test_lanes_of_all_tilts_and_of_none_are_each_as_if_alone():
    tilts = [None, *TILTS, None, *reversed(TILTS), None]
    models = [sheet_at(flat_sheet() if tilt is None else tilted(flat_sheet(), tilt), tilt) for tilt in tilts]
    hands = [lifting_hand() if tilt is None else recorded(lifting_hand(), tilt) for tilt in tilts]
    together = run(models, hands)
    for row, (model, hand) in enumerate(zip(models, hands, strict=True)):
        alone = run([model], [hand])
        assert together.positions[row] == pytest.approx(alone.positions[0], abs=1e-6), tilts[row]
        assert together.velocities[row] == pytest.approx(alone.velocities[0], abs=1e-4), tilts[row]


def test_models_without_the_effect_have_no_frames():
    idle = idle_controls(frame_times(0.1, 1 / 30))
    assert batch_of_models([sheet_at(flat_sheet())], [idle], ground_height=0.0).frames is None


def test_frames_that_are_not_one_for_each_rollout_are_refused():
    batch = batch_of_models([sheet_at(flat_sheet())], [idle_controls(frame_times(0.1, 1 / 30))], ground_height=0.0)
    with pytest.raises(SimulationError, match=r"frames must be \(1, 4, 4\), got \(3, 3\)"):
        replace(batch, frames=np.eye(3))
