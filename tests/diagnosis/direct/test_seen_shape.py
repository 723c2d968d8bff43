"""Where all of a sheet is of which a part is seen."""

import numpy as np
import pytest

from egophys_core.diagnosis.direct.seen_shape import normal_products, seen_sheet
from egophys_core.geometry import about_vertical
from egophys_core.kinds.surface_faces import faces_of_sheet

WIDE, LONG = 0.3, 0.4


def nodes() -> np.ndarray:
    """[N, 3] a sheet on a table."""
    across, along = np.meshgrid(np.linspace(0.0, WIDE, 9), np.linspace(0.0, LONG, 12))
    return np.stack([across.ravel(), along.ravel(), np.full(across.size, 0.8)], axis=1)


def tracks(count: int = 150) -> np.ndarray:
    """[P, 3] places of the same sheet."""
    places = np.random.default_rng(3).uniform(0.0, 1.0, (count, 2)) * [WIDE, LONG]
    return np.column_stack([places, np.full(count, 0.8)])


def rolled(rest: np.ndarray) -> np.ndarray:
    """Where places of the sheet are when it is rolled half round a cylinder, and turned."""
    angle = np.pi * rest[:, 1] / LONG
    places = np.stack([rest[:, 0], LONG / np.pi * np.sin(angle), LONG / np.pi * (1.0 - np.cos(angle))], axis=1)
    return about_vertical(places, np.full(len(rest), 0.7))


def some_hidden(rest: np.ndarray, positions: np.ndarray, *, share: float) -> np.ndarray:
    """Tracks of which those are hidden that lie in a share of the sheet."""
    return np.where((rest[:, 1] < share * LONG)[:, None], np.nan, positions)


def test_the_middle_of_what_is_partly_hidden_is_that_of_all_of_it():
    rest, expected = tracks(), rolled(nodes())
    seen = some_hidden(rest, rolled(rest), share=0.12)
    (found,) = seen_sheet(nodes(), rest, seen[None])
    assert np.linalg.norm(found.mean(axis=0) - expected.mean(axis=0)) < 0.004
    assert np.linalg.norm(np.nanmean(seen, axis=0) - expected.mean(axis=0)) > 0.015


def test_how_it_lay_at_rest_is_no_matter():
    rest = tracks()
    expected = seen_sheet(nodes(), rest, rolled(rest)[None])
    tipped = [each[:, [2, 0, 1]] + [0.3, 0.0, -0.1] for each in (nodes(), rest)]
    found = seen_sheet(*tipped, rolled(rest)[None])
    assert np.isfinite(expected).all()
    assert found == pytest.approx(expected, abs=1e-9)


def test_tracks_of_one_place_are_no_contradiction():
    rest = np.repeat(tracks(80), 2, axis=0)
    positions = rolled(rest) + np.random.default_rng(0).normal(0.0, 1e-3, rest.shape)
    (found,) = seen_sheet(nodes(), rest, positions[None])
    assert np.linalg.norm(found.mean(axis=0) - rolled(nodes()).mean(axis=0)) < 0.002
    assert np.abs(found - rolled(nodes())).max() < 0.03


@pytest.mark.parametrize("share", [0.5, 1.1])
def test_of_what_shows_too_little_nothing_is_made_up(share: float):
    rest = tracks()
    frames = np.array([rolled(rest), some_hidden(rest, rolled(rest), share=share)])
    all_of_it, too_little = seen_sheet(nodes(), rest, frames)
    assert np.isfinite(all_of_it).all()
    assert np.isnan(too_little).all()


def test_tracks_that_are_few_or_on_one_line_tell_nothing():
    rest = tracks()
    assert np.isnan(seen_sheet(nodes(), rest[:8], rolled(rest[:8])[None])).all()
    line = np.stack([np.full(40, WIDE / 2.0), np.linspace(0.0, LONG, 40), np.full(40, 0.8)], axis=1)
    ribbon = (nodes() - [WIDE / 2.0, 0.0, 0.0]) * [0.3, 1.0, 1.0] + [WIDE / 2.0, 0.0, 0.0]
    assert np.isnan(seen_sheet(ribbon, line, rolled(line)[None])).all()


def test_a_flat_sheet_faces_along_its_normal_and_a_rolled_one_all_ways():
    flat, half_round, faces = nodes(), about_vertical(rolled(nodes()), np.full(108, -0.7)), faces_of_sheet(nodes())
    both = normal_products(np.array([flat, half_round]), faces)
    assert both[0] == pytest.approx(np.diag([0.0, 0.0, 1.0]), abs=1e-9)
    assert both[1] == pytest.approx(np.diag([0.0, 0.5, 0.5]), abs=0.01)
