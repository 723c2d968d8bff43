"""Grips: tracks that follow a hand among others that do not, and what they say of its record."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.diagnosis.direct.grip_fit import Parameters, explained, fit_grips, gains, intervals, p_null
from egophys_core.diagnosis.direct.grips import GripRecord, held, held_displacements, residual_of

TIMES = np.arange(181) / 30.0
HOLDS = slice(30, 181)


def path(seed: int) -> np.ndarray:
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
    """Six tracks in a hand, and eight beside it that follow half of its path, half a second later."""
    random = np.random.default_rng(seed + 100)
    levers = random.uniform(-0.02, 0.02, (14, 3))
    turned = Rotation.from_rotvec(np.outer(np.sin(np.maximum(TIMES - 1.0, 0.0)), [0.0, turn, 0.0])).as_matrix()
    record = GripRecord(
        times=TIMES[HOLDS],
        tracks=np.zeros((len(TIMES[HOLDS]), len(levers), 3)),
        levers=levers,
        record_times=TIMES,
        centres=path(seed),
        turned=turned,
        pulls=np.tile([0.0, 0.0, -1.0], (len(TIMES[HOLDS]), 1)),
    )
    tracks = levers + carried(record, delay) + scale * moved(record, delay)[:, None]
    tracks += (np.maximum(record.times - onset, 0.0)[:, None] * np.array(slip))[:, None]
    tracks[:, 6:] = levers[6:] + 0.5 * moved(record, 0.5)[:, None]
    tracks += random.normal(scale=noise, size=tracks.shape)
    hidden = random.random(tracks.shape[:2]) < 0.1
    return replace(record, tracks=np.where(hidden[..., None], np.nan, tracks))


def moved(record: GripRecord, delay: float) -> np.ndarray:
    """[F, 3] metres: c(t - d) - c(t_0 - d), c by straight lines between the frames of its record."""
    found = [np.interp(record.times - delay, TIMES, record.centres[:, axis]) for axis in range(3)]
    return np.stack(found, axis=1) - [each[0] for each in found]


def carried(record: GripRecord, delay: float) -> np.ndarray:
    """[F, P, 3] metres: (R(t - d) - 1) l for the levers l."""
    entries = [np.interp(record.times - delay, TIMES, each) for each in record.turned.reshape(len(TIMES), 9).T]
    turned = np.stack(entries, axis=1).reshape(-1, 3, 3)
    return np.einsum("fij,pj->fpi", turned - np.eye(3), record.levers)


def as_recorded(record: GripRecord) -> np.ndarray:
    """[F, P, 3] metres: what the tracks leave if the record of the hand is right."""
    return residual_of(record, held_displacements(record, {}))


def test_what_slips_goes_where_it_is_pulled_and_stays_where_it_is_hardly_pulled():
    record = grip()
    aside = np.array([0.6, 0.0, 0.0])
    halves = [0.02 * aside] * (len(record.times) // 2) + [aside] * (len(record.times) - len(record.times) // 2)
    slip = {"grasp_slip": {"x": 0.0, "y": 0.0, "z": -0.012, "onset": 0.0}}
    slid = held_displacements(replace(record, pulls=np.array(halves)), slip) - held_displacements(record, {})
    assert slid[-1, 0] == pytest.approx([0.012 * record.seconds / 2, 0.0, 0.0], abs=1e-3)


def three(**changes: object) -> list[GripRecord]:
    return [grip(seed, **changes) for seed in range(3)]  # type: ignore[arg-type]


def test_what_is_held_is_told_from_what_lags():
    record = grip()
    tracks, square = held(record, as_recorded(record))
    assert len(tracks) == 4
    assert tracks.max() < 6
    assert np.sqrt(square) == pytest.approx(5e-4, rel=0.25)


def test_what_is_held_goes_round_with_a_hand_that_turns():
    record = grip(turn=0.6)
    _, square = held(record, as_recorded(record))
    assert np.sqrt(square) == pytest.approx(5e-4, rel=0.25)


def test_a_track_seen_for_a_moment_is_not_taken_for_held():
    record = grip()
    rarely = record.tracks.copy()
    rarely[12:, 6:] = np.nan
    record = replace(record, tracks=rarely)
    tracks, _ = held(record, as_recorded(record))
    assert tracks.max() < 6


@pytest.mark.parametrize(
    ("injected", "numbers", "within"),
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
def test_the_numbers_come_back(injected: dict[str, object], numbers: Parameters, within: float):
    grips = three(**injected)
    ((name, expected),) = numbers.items()
    fit = fit_grips(grips, (name,))
    assert set(fit.values) == {name}
    for each, value in expected.items():
        assert fit.values[name][each] == pytest.approx(
            value, abs=within if each in ("onset", "delay", "scale") else 1e-3
        )
    before = explained(grips, {})
    assert (gains(grips, before, fit) > 10.0).all()
    assert p_null(grips, before, fit, seed=0) < 0.05
    for each, (low, high) in intervals(grips, fit, resamples=200, seed=0)[name].items():
        assert low < fit.values[name][each] < high


def test_a_delay_and_a_slip_are_told_apart():
    grips = three(delay=0.08, slip=(0.0, 0.0, -0.01), onset=2.0)
    fit = fit_grips(grips, ("control_delay", "grasp_slip"))
    assert fit.values["control_delay"]["delay"] == pytest.approx(0.08, abs=0.003)
    assert fit.values["grasp_slip"]["z"] == pytest.approx(-0.01, abs=1e-3)


@pytest.mark.parametrize("name", ["control_delay", "tracking_scale", "grasp_slip"])
def test_a_clean_grip_gains_nothing(name: str):
    grips = three()
    assert gains(grips, explained(grips, {}), fit_grips(grips, (name,))).sum() < 1.0
