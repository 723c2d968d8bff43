"""What is measured directly: effects of hands and tracking frame in episodes of our simulator, by whatever twin."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import interp1d

from egophys_core.diagnosis.direct.measure import measure
from egophys_core.diagnosis.direct.measured import MeasuredEffect
from egophys_core.diagnosis.tracked_episode import TrackedEpisode, observe
from egophys_core.effects import TwinEffect
from egophys_core.effects.rotations import rotation
from egophys_core.episode import Episode
from egophys_core.kinds.kind import RestShape
from egophys_core.twin import ObjectModel
from tests.identification.synthetic import known_model, make_episode
from tests.simulation.scenes import sheet_positions

EXPECTED = {
    "control_delay": {"delay": 0.1},
    "tracking_scale": {"scale": 0.9},
    "grasp_slip": {"x": -0.02, "y": -0.01, "z": -0.01, "onset": 1.5},
    "tracking_rotation": {"about_x": 0.05, "about_y": -0.03},
}


@cache
def fine_sheet() -> ObjectModel:
    """A sheet whose nodes lie as close as tracks of a towel do, in a firm grip."""
    shape = RestShape(
        positions=sheet_positions(11, 0.018, 0.004), surface=np.ones(121, bool), kind="sheet", spacing=0.018
    )
    model = known_model(shape)
    return replace(model, parameters=replace(model.parameters, controller_stiffness=2000.0))


def recorded(episode: Episode, *names: str) -> Episode:
    """The episode as another tracker, or a clock that is off, would have recorded it."""
    points, hands = episode.points.astype(float), episode.controllers.astype(float)
    if "control_delay" in names:
        early = episode.times + EXPECTED["control_delay"]["delay"]
        hands = interp1d(episode.times, hands, axis=0, bounds_error=False, fill_value=(hands[0], hands[-1]))(early)
    if "tracking_scale" in names:
        points = EXPECTED["tracking_scale"]["scale"] * points
    if "tracking_rotation" in names:
        turn = rotation(np.array([*EXPECTED["tracking_rotation"].values(), 0.0]))
        points, hands = points @ turn.T, hands @ turn.T
    return replace(episode, points=points.astype(np.float32), controllers=hands.astype(np.float32))


@cache
def measured_episodes(*names: str) -> list[Episode]:
    """Three motions under effects."""
    slips = (TwinEffect(name="grasp_slip", values=EXPECTED["grasp_slip"]),) if "grasp_slip" in names else ()
    model = replace(fine_sheet(), effects=slips)
    carries = {"lift": (0.06, 0.04, 0.2), "swing": (-0.12, 0.1, 0.16), "away": (-0.1, -0.1, 0.18)}
    return [
        recorded(make_episode(model, name=name, duration=3.2, carry=carry, noise_m=0.001), *names)
        for name, carry in carries.items()
    ]


@cache
def observed(*names: str) -> list[TrackedEpisode]:
    """The same beside the twin without the effects."""
    return [observe(fine_sheet(), episode) for episode in measured_episodes(*names)]


def measured(
    fitted: list[TrackedEpisode],
    validation: list[TrackedEpisode],
    *,
    lies_flat: bool = True,
    without: tuple[str, ...] = (),
) -> list[MeasuredEffect]:
    return measure(fitted, validation, lies_flat=lies_flat, without=without, resamples=200, seed=0)


@pytest.mark.parametrize(
    ("name", "within"),
    [("control_delay", 0.005), ("tracking_scale", 0.02), ("grasp_slip", 0.003), ("tracking_rotation", 0.003)],
)
def test_an_effect_is_measured_with_its_numbers(name: str, within: float):
    *fitted, validation = observed(name)
    found, *others = measured(fitted, [validation])
    assert found.name == name
    assert not any(each.shows for each in others)
    assert {name, *(each.name for each in others)} == set(EXPECTED)
    for number, value in EXPECTED[name].items():
        assert found.values[number] == pytest.approx(value, abs=0.2 if number == "onset" else within)
    assert found.episodes_agree
    assert min(found.fitted_gain, found.held_out_gain) >= 12.0
    assert found.validation_gain is not None
    assert found.validation_gain > 0.0
    assert name in found.reason


def test_nothing_injected_nothing_shows():
    *fitted, validation = observed()
    found = measured(fitted, [validation])
    assert {each.name for each in found} == set(EXPECTED)
    assert not any(each.shows for each in found)


def test_an_effect_left_out_is_not_measured():
    *fitted, validation = observed("tracking_rotation")
    assert "tracking_rotation" not in {
        each.name for each in measured(fitted, [validation], without=("tracking_rotation",))
    }


def test_one_motion_measures_nothing():
    assert measured(observed("control_delay")[:1], []) == []


def test_a_toy_does_not_tell_how_level_its_table_is():
    *fitted, validation = observed("tracking_rotation")
    assert "tracking_rotation" not in {each.name for each in measured(fitted, [validation], lies_flat=False)}


def test_what_a_validation_episode_refutes_does_not_show():
    fitted, validation = observed("control_delay")[:2], observed()[2]
    found = {each.name: each for each in measured(fitted, [validation])}
    assert not any(each.shows for each in found.values())
    assert [each.name for each in found["control_delay"].criteria if not each.passed] == ["validation"]


@pytest.mark.slow
def test_a_grip_may_slip_in_some_motions_only():
    fitted, validation = observed("grasp_slip")[:2], observed()[2]
    assert [each.name for each in measured(fitted, [validation]) if each.shows] == ["grasp_slip"]


def test_two_effects_are_measured_together():
    *fitted, validation = observed("control_delay", "tracking_rotation")
    shown = {each.name for each in measured(fitted, [validation]) if each.shows}
    assert shown == {"control_delay", "tracking_rotation"}
