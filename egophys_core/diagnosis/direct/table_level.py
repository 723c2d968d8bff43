"""How level the table is in the tracking frame: a sheet that lies flat on it tells, whatever it is made of."""

import numpy as np

from egophys_core.effects.rotations import rotation

FLAT_M = 0.003
"""Metres, root mean square, by which tracks of a sheet that lies flat leave a plane at most."""

FEWEST_TRACKS = 10

FLOOR = 1e-3
"""Metres by which a flat sheet leaves a plane anyway: folds and noise."""

PLACES = 12.0
"""Heights that a sheet at rest tells independently."""


def tilt(rest: np.ndarray) -> np.ndarray | None:
    """[2] rad about x and y that turn a level table to how a sheet lies whose tracks rest at [P, 3] metres.

    None where it does not lie flat.
    """
    if len(rest) < FEWEST_TRACKS:
        return None
    centred = rest - rest.mean(axis=0)
    slope, *_ = np.linalg.lstsq(centred[:, :2], centred[:, 2], rcond=None)
    if np.mean((centred[:, 2] - centred[:, :2] @ slope) ** 2) > FLAT_M**2:
        return None
    steep = float(np.linalg.norm(slope))
    return np.asarray(np.arctan(steep) / max(steep, 1e-12) * np.array([slope[1], -slope[0]]))


def tilt_gain(rest: np.ndarray, about: np.ndarray) -> float:
    """Gain in log-likelihood of a tilt [2] rad over a level table, by tracks [P, 3] of a sheet at rest."""
    upright = rest @ rotation(np.array([*about, 0.0]))
    return float(PLACES / 2.0 * np.log((rest[:, 2].var() + FLOOR**2) / (upright[:, 2].var() + FLOOR**2)))
