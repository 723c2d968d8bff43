"""How solids round off towards their outline: ellipsoids exactly, whatever the outline."""

import numpy as np
import pytest

from egophys_core.perception.surface.rounding import rounded, torsion

ROWS, COLUMNS = np.mgrid[:120, :160].astype(float)
HALF = (60.0, 40.0)
ELLIPSE = ((COLUMNS - 80) / HALF[0]) ** 2 + ((ROWS - 60) / HALF[1]) ** 2


def test_torsion_of_an_ellipse_is_its_quadratic() -> None:
    # Laplace of 1 - x^2/a^2 - y^2/b^2 is -2 (1/a^2 + 1/b^2).
    expected = np.maximum(1 - ELLIPSE, 0) / (2 * (HALF[0] ** -2 + HALF[1] ** -2))
    np.testing.assert_allclose(torsion(ELLIPSE < 1), expected, atol=0.03 * expected.max())


def test_torsion_of_nothing_and_of_one_pixel() -> None:
    nothing = np.zeros((5, 6), bool)
    assert not torsion(nothing).any()
    nothing[2, 3] = True
    assert torsion(nothing)[2, 3] == pytest.approx(0.25)


@pytest.mark.parametrize("swell", [0.3, 0.0])
def test_the_rim_follows_from_the_inside_and_wrong_places_do_not_matter(swell: float) -> None:
    mask = ELLIPSE < 1
    rows, columns = np.nonzero(mask & (ROWS % 5 == 0) & (COLUMNS % 5 == 0))
    pixels = np.column_stack([columns, rows]).astype(float)
    share = ELLIPSE[rows, columns]
    true = 1.6 + 0.001 * columns - 0.002 * rows + swell * np.sqrt(1 - share)
    inner = share < 0.6
    given = np.where(inner, true, 1.9)
    given[np.flatnonzero(inner)[::10]] += 0.2
    found = rounded(mask, pixels, given, inner)
    assert np.abs(found - true)[inner].max() < 0.005
    assert np.abs(found - true).max() < 0.03


def test_a_hollow_stays_a_plane() -> None:
    rows, columns = np.nonzero((ELLIPSE < 0.9) & (ROWS % 6 == 0) & (COLUMNS % 6 == 0))
    pixels = np.column_stack([columns, rows]).astype(float)
    hollow = 1.6 - 0.3 * np.sqrt(1 - ELLIPSE[rows, columns])
    found = rounded(ELLIPSE < 1, pixels, hollow, np.ones(len(rows), bool))
    columns_of = np.column_stack([np.ones(len(pixels)), pixels])
    plane = columns_of @ np.linalg.lstsq(columns_of, found, rcond=None)[0]
    np.testing.assert_allclose(found, plane, atol=1e-9)
