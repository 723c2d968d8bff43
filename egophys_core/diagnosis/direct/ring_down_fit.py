"""What ring-downs say of the material: whether part of its force relaxes, how much of it, and how fast.

An oscillator with a Maxwell arm: y'' = -w^2 (y - e + ratio (y - q)) - c y', q' = (y - q) / time. Rate w, damping c,
middle e and how it was let go are each record's own: so neither the stiffness nor the mount of a record, nor a damping
that is another at each frequency, is taken for relaxation. Ratio and time are the same in all records.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from egophys_core.diagnosis.direct.ring_down import RingDown

FLOOR = 2e-5
"""Metres by which an oscillator is off anyway: noise of markers."""

RATIO_BOUNDS, TIME_BOUNDS = (1e-4, 5.0), (0.06, 10.0)
"""Of the arm; s. What relaxes faster is a damper to oscillations of some Hz."""

STARTS = (0.1, 0.4, 1.5)
"""Seconds at which the search for a time starts."""

FIRST_RATIO, FIRST_DAMPING = 0.1, 2.0
"""1; 1/s."""

WEIGHINGS = 3
"""Times that records are weighed anew by what is left of each."""


@dataclass(frozen=True, kw_only=True)
class RingDownFit:
    """Ring-downs with the parameters of what relaxes in them."""

    ratio: float
    """0 for nothing."""
    time: float
    """Seconds."""
    left: list[np.ndarray]
    """Per record [F] metres: what its oscillator leaves."""
    ci95: dict[str, tuple[float, float]]
    """Of the parameters that were fitted."""

    @property
    def squares(self) -> np.ndarray:
        """[R] mean square of what is left of each record, m^2."""
        return np.array([np.mean(each**2) for each in self.left])


def explained_ring_downs(records: Sequence[RingDown], ratio: float = 0.0, time: float = 1.0) -> RingDownFit:
    """How well given parameters explain ring-downs; by default without any relaxation."""
    left = []
    for record in records:

        def errors(own: np.ndarray, record: RingDown = record) -> np.ndarray:
            return _left(record, own, ratio, time)

        own = least_squares(errors, _own_start(record), bounds=_own_bounds(), x_scale=(0.01, 0.3)).x
        left.append(_left(record, own, ratio, time))
    return RingDownFit(ratio=ratio, time=time, left=left, ci95={})


def fit_ring_downs(records: Sequence[RingDown]) -> RingDownFit:
    """Ratio and time that explain ring-downs best."""
    fits = [_descend(records, time) for time in STARTS]
    return min(fits, key=lambda fit: float(counts(records) @ np.log(fit.squares + FLOOR**2)))


def ring_down_gains(records: Sequence[RingDown], before: RingDownFit, after: RingDownFit) -> np.ndarray:
    """[R] gain in log-likelihood in each ring-down."""
    return counts(records) / 2.0 * np.log((before.squares + FLOOR**2) / (after.squares + FLOOR**2))


def counts(records: Sequence[RingDown]) -> np.ndarray:
    """[R] how many independent values each record holds: what an oscillator leaves is alike over a period."""
    return np.array([record.times[-1] * record.rate / (2.0 * np.pi) for record in records])


def _descend(records: Sequence[RingDown], time: float) -> RingDownFit:
    """Down to the nearest optimum from a time."""
    at = np.concatenate([np.log([FIRST_RATIO, time]), *(_own_start(record) for record in records)])
    low, high = (
        np.concatenate([np.log([RATIO_BOUNDS[end], TIME_BOUNDS[end]]), *[_own_bounds()[end]] * len(records)])
        for end in (0, 1)
    )
    steps = np.array([0.1, 0.1, *(0.01, 0.3) * len(records)])

    def of_each(at: np.ndarray) -> list[np.ndarray]:
        ratio, time = np.exp(at[:2])
        return [_left(record, own, ratio, time) for record, own in zip(records, at[2:].reshape(-1, 2), strict=True)]

    weights = np.ones(len(records))
    for _ in range(WEIGHINGS):

        def errors(at: np.ndarray, weights: np.ndarray = weights) -> np.ndarray:
            return np.concatenate([weight * each for weight, each in zip(weights, of_each(at), strict=True)])

        found = least_squares(errors, at, bounds=(low, high), x_scale=steps)
        at, left = found.x, of_each(found.x)
        # Squares of each record sum up to how many independent values it holds.
        weights = np.sqrt([
            count / (np.sum(each**2) + len(each) * FLOOR**2)
            for count, each in zip(counts(records), left, strict=True)
        ])  # fmt: skip
    covariance = np.linalg.pinv(found.jac.T @ found.jac)
    wide = 1.96 * np.sqrt(np.diag(covariance)[:2])
    ends = np.exp(np.clip([at[:2] - wide, at[:2] + wide], low[:2], high[:2])).T
    return RingDownFit(
        ratio=float(np.exp(at[0])),
        time=float(np.exp(at[1])),
        left=left,
        ci95={name: (float(below), float(above)) for name, (below, above) in zip(("ratio", "time"), ends, strict=True)},
    )


def _own_start(record: RingDown) -> np.ndarray:
    """Log of the rate and damping of one record."""
    return np.array([np.log(record.rate), FIRST_DAMPING])


def _own_bounds() -> tuple[np.ndarray, np.ndarray]:
    return np.array([-np.inf, 0.0]), np.array([np.inf, np.inf])


def _left(record: RingDown, own: np.ndarray, ratio: float, time: float) -> np.ndarray:
    """[F] metres: what the best middle, first place and first speed leave of a record.

    The oscillator is linear in these three; how far it has relaxed when it first turns back
    follows from how it got there.
    """
    rate, damping = float(np.exp(own[0])), float(own[1])
    relaxed = _relaxed(record, time)
    matrix = np.array(
        [[0.0, 1.0, 0.0], [-(rate**2) * (1.0 + ratio), -damping, rate**2 * ratio], [1.0 / time, 0.0, -1.0 / time]]
    )
    values, vectors = np.linalg.eig(matrix)
    # Place in time [F] from a first place, speed and relaxed place of 1 each.
    place, speed, memory = ((np.exp(record.times[:, None] * values) * vectors[0]) @ np.linalg.inv(vectors)).real.T
    columns = np.stack([1.0 - place - memory, place, speed], axis=1)
    target = record.places - relaxed * memory
    return np.asarray(target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0])


def _relaxed(record: RingDown, time: float) -> float:
    """q in metres when a record first turns back, having been where the object was held until it was let go."""
    ends = np.append(record.earlier_times, 0.0)
    places = np.append(record.earlier, record.places[0])
    # The arm's share of each stretch, of places in its middle, that is not forgotten.
    fading = np.exp(ends / time)
    share = np.diff(fading)
    return float(places[0] * fading[0] + share @ (places[:-1] + places[1:]) / 2.0)
