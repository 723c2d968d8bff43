"""Grips: tracks that follow a hand among others that do not, and what they say of its record."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.diagnosis.direct.grip_fit import Numbers, explained, fit_grips, gains, intervals, p_null
from egophys_core.diagnosis.direct.grips import HELD_TRACKS, GripRecord, follows, held, missed

TIMES = np.arange(181) / 30.0
HOLDS = slice(30, 181)


def way(seed: int) -> np.ndarray:
    """[T, 3] metres: up from the first second on, then to and fro."""
    random = np.random.default_rng(seed)
    since = np.maximum(TIMES - 1.0, 0.0)[:, None]
    sway = random.uniform(0.03, 0.06, 3) * np.sin(random.uniform(1.5, 2.5, 3) * since)
    return np.array([0.0, 0.0, 0.12]) * (1.0 - np.exp(-2.0 * since)) + sway


def grip(
    seed: int = 0,
    *,
    delay: float = 0.0,
    scale: float = 1.0,
    slip: tuple[float, float, float] = (0.0, 0.0, 0.0),
    onset: float = 0.0,
    noise: float = 5e-4,
    turn: float = 0.0,
) -> GripRecord:
    """Six tracks in a hand, and eight beside it that follow half of its way, half a second later."""
    random = np.random.default_rng(seed + 100)
    levers = random.uniform(-0.02, 0.02, (14, 3))
    turned = Rotation.from_rotvec(np.outer(np.sin(np.maximum(TIMES - 1.0, 0.0)), [0.0, turn, 0.0])).as_matrix()
    record = GripRecord(
        times=TIMES[HOLDS],
        tracks=np.zeros((len(TIMES[HOLDS]), len(levers), 3)),
        levers=levers,
        record_times=TIMES,
        centres=way(seed),
        turned=turned,
    )
    tracks = levers + follows(record, delay=delay, scale=scale, slip=np.array(slip), onset=onset)
    tracks[:, 6:] = levers[6:] + 0.5 * record.moved(0.5)[:, None]
    tracks += random.normal(scale=noise, size=tracks.shape)
    hidden = random.random(tracks.shape[:2]) < 0.1
    return replace(record, tracks=np.where(hidden[..., None], np.nan, tracks))


def three(**changes: object) -> list[GripRecord]:
    return [grip(seed, **changes) for seed in range(3)]  # type: ignore[arg-type]


def test_what_is_held_is_told_from_what_lags():
    record = grip()
    tracks, square = held(record, missed(record, follows(record, delay=0.0, scale=1.0, slip=np.zeros(3), onset=0.0)))
    assert len(tracks) == HELD_TRACKS
    assert tracks.max() < 6
    assert np.sqrt(square) == pytest.approx(5e-4, rel=0.25)


def test_what_is_held_goes_round_with_a_hand_that_turns():
    record = grip(turn=0.6)
    _, square = held(record, missed(record, follows(record, delay=0.0, scale=1.0, slip=np.zeros(3), onset=0.0)))
    assert np.sqrt(square) == pytest.approx(5e-4, rel=0.25)


def test_a_track_seen_for_a_moment_is_not_taken_for_held():
    record = grip()
    rarely = record.tracks.copy()
    rarely[12:, 6:] = np.nan
    record = replace(record, tracks=rarely)
    tracks, _ = held(record, missed(record, follows(record, delay=0.0, scale=1.0, slip=np.zeros(3), onset=0.0)))
    assert tracks.max() < 6


@pytest.mark.parametrize(
    ("planted", "numbers", "within"),
    [
        ({"delay": 0.07}, {"control_delay": {"delay": 0.07}}, 0.002),
        ({"delay": -0.04}, {"control_delay": {"delay": -0.04}}, 0.002),
        ({"scale": 0.94}, {"tracking_scale": {"scale": 0.94}}, 0.01),
        (
            {"slip": (-0.01, 0.004, -0.012), "onset": 3.3},
            {"grasp_slip": {"x": -0.01, "y": 0.004, "z": -0.012, "onset": 3.3}},
            0.1,
        ),
    ],
)
def test_the_numbers_come_back(planted: dict[str, object], numbers: Numbers, within: float):
    grips = three(**planted)
    ((name, expected),) = numbers.items()
    fit = fit_grips(grips, (name,))
    assert set(fit.numbers) == {name}
    for each, value in expected.items():
        assert fit.numbers[name][each] == pytest.approx(
            value, abs=within if each in ("onset", "delay", "scale") else 1e-3
        )
    before = explained(grips, {})
    assert (gains(grips, before, fit) > 10.0).all()
    assert p_null(grips, before, fit, seed=0) < 0.05
    for each, (low, high) in intervals(grips, fit, resamples=200, seed=0)[name].items():
        assert low < fit.numbers[name][each] < high


def test_a_delay_and_a_slip_are_told_apart():
    grips = three(delay=0.08, slip=(0.0, 0.0, -0.01), onset=2.0)
    fit = fit_grips(grips, ("control_delay", "grasp_slip"))
    assert fit.numbers["control_delay"]["delay"] == pytest.approx(0.08, abs=0.003)
    assert fit.numbers["grasp_slip"]["z"] == pytest.approx(-0.01, abs=1e-3)


@pytest.mark.parametrize("name", ["control_delay", "tracking_scale", "grasp_slip"])
def test_a_clean_grip_gains_nothing(name: str):
    grips = three()
    assert gains(grips, explained(grips, {}), fit_grips(grips, (name,))).sum() < 1.0
