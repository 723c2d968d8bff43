"""The observer: at rest with what it predicts well, off by a / w^2 where a force per mass is missing."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.evidence import residuals as residuals_module
from egophys_core.diagnosis.evidence.residuals import block_means, residuals, track_offsets
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import TwinEffect
from tests.diagnosis.rehearsed import WIND, episodes, sheet


def test_the_true_model_leaves_next_to_nothing():
    observation = observe(sheet(), episodes(noise_m=0.0)[0])
    offsets, diverged = track_offsets(observation, [sheet()])
    assert not diverged.any()
    assert np.nanmedian(np.abs(offsets)) < 5e-4


def test_a_missing_force_shows_as_an_offset_along_it():
    """Free of hand and table the offset tends to a / w^2; where the sheet is held it is less, and never against it."""
    observation = observe(sheet(), episodes(WIND, noise_m=0.0)[0])
    offsets, _ = track_offsets(observation, [sheet(), replace(sheet(), effects=(WIND,))])
    wind = np.array([WIND.values[axis] for axis in "xyz"])
    limit = np.linalg.norm(wind) / 5.0**2
    late = np.nanmean(offsets[0][-30:], axis=(0, 1))
    along = late @ wind / np.linalg.norm(wind)
    assert 0.02 * limit < along < 1.1 * limit
    assert np.nanmedian(np.abs(offsets[1])) < 0.2 * np.nanmedian(np.abs(offsets[0]))


def test_what_is_at_rest_stays_so_until_it_is_touched():
    """A twin that lacks nothing lies still before; one with another weight or table may slide or roll, and is held
    askew then."""
    observation = observe(sheet(), episodes()[0])
    steep = TwinEffect(name="gravity_tilt", values={"about_x": 0.5, "about_y": -0.5})
    offsets, _ = track_offsets(observation, [sheet(), replace(sheet(), effects=(steep,))])
    np.testing.assert_array_equal(offsets[0][0], offsets[1][0])
    assert offsets.shape[1] == len(observation.episode.times) - observation.touched
    assert not np.array_equal(offsets[0][3], offsets[1][3])


def test_block_means_are_the_means_of_their_tracks():
    observation = observe(sheet(), episodes()[0])
    frames = len(observation.episode.times) - observation.touched
    offsets = np.ones((1, frames, len(observation.patches), 3)) * observation.patches[None, None, :, None]
    means = block_means(observation, offsets)
    assert means.shape == (1, observation.block_count, 12, 3)
    assert np.nanmax(np.abs(means[0] - np.arange(12)[None, :, None])) == pytest.approx(0.0)


def test_episodes_side_by_side_are_as_one_after_the_other():
    observations = [observe(sheet(), episode) for episode in episodes()]
    together = residuals(observations, [sheet()])
    alone = [residuals([each], [sheet()])[0] for each in observations]
    for one, other in zip(together, alone, strict=True):
        assert np.array_equal(one, other, equal_nan=True)


@pytest.mark.parametrize("cores", [1, 2, 3])
def test_models_are_as_one_after_the_other_on_any_number_of_cores(cores, monkeypatch):
    monkeypatch.setattr(residuals_module, "usable_cores", lambda: cores)
    observations = [observe(sheet(), episode) for episode in episodes()]
    models = [replace(sheet(), parameters=replace(sheet().parameters, drag=0.1 * row)) for row in range(19)]
    shares = []
    together = residuals(observations, models, progress=shares.append)
    assert shares[-1] == 1.0
    for row in (0, 8, 18):
        for one, other in zip(together, residuals(observations, [models[row]]), strict=True):
            assert np.array_equal(one[row], other[0], equal_nan=True)


def test_progress_may_stop_and_nothing_is_begun_any_more(monkeypatch):
    begun = []
    monkeypatch.setattr(residuals_module, "usable_cores", lambda: 1)

    def counted(observation, models, **more):
        begun.append(models)
        return track_offsets(observation, models, **more)

    monkeypatch.setattr(residuals_module, "track_offsets", counted)

    def stop(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        residuals([observe(sheet(), episodes()[0])], [sheet()] * 32 * 20, progress=stop)
    assert len(begun) < 20


def test_no_model_has_no_residuals():
    assert residuals([observe(sheet(), episodes()[0])], []) == []
