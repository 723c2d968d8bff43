"""The outline of a hand as an ellipse: exact, whatever hides a part of it, and none where there is none."""

import numpy as np
import pytest

from egophys_core.perception.hands.hand_outline import HandOutline, find_outline, follow_outline, likelihood
from tests.perception.hands.drawn_outline import SIDE, coverage, picture


def outline(centre: tuple[float, float], half_widths: tuple[float, float]) -> HandOutline:
    return HandOutline(centre=np.array(centre), form=np.diag(1 / np.array(half_widths) ** 2), support=1.0)


def hand_like(centre: tuple[float, float], half_widths: tuple[float, float], angle: float = 0.0) -> np.ndarray:
    return coverage(centre, half_widths, angle).astype(np.float32)


@pytest.mark.parametrize(
    ("x", "y", "size", "longer", "angle"),
    [(120.3, 131.7, 18.2, 1.2, 70.0), (181.6, 155.2, 31.4, 1.0, 0.0), (150.1, 160.9, 44.8, 1.15, 130.0)],
)
def test_an_ellipse_is_found_to_a_fraction_of_a_pixel(
    x: float, y: float, size: float, longer: float, angle: float
) -> None:
    widths = (size * longer, size)
    image = picture((x, y), widths, angle=angle)
    found = find_outline(image, hand_like((x, y), widths, angle), np.array([x + 4, y - 5]), 0.8 * size)
    assert found is not None
    np.testing.assert_allclose(found.centre, [x, y], atol=0.3)
    # Roundness is wished for a little.
    np.testing.assert_allclose(found.half_widths, [size, size * longer], rtol=0.035)
    assert found.size == pytest.approx(size * np.sqrt(longer), rel=0.01)
    assert found.support > 0.85


def test_the_width_is_right_though_arm_and_object_hide_parts() -> None:
    place, widths = (160.0, 150.0), (34.0, 31.0)
    image = picture(place, widths, arm_to=(330.0, 170.0))
    image[165:, :150] = np.random.default_rng(1).integers(40, 250, (SIDE - 165, 150, 3))
    likely = hand_like(place, widths)
    likely[165:, :150] = 0.0
    likely[140:180, 160:] = 1.0
    found = find_outline(image, likely, np.array([165.0, 147.0]), 26.0)
    assert found is not None
    np.testing.assert_allclose(found.centre, place, atol=0.7)
    assert found.half_widths[0] == pytest.approx(31.0, rel=0.025)


def test_a_followed_outline_keeps_its_size_where_hardly_a_third_is_seen() -> None:
    place, widths = (160.0, 150.0), (32.0, 32.0)
    image, likely = picture(place, widths), hand_like(place, widths)
    rows = slice(145, SIDE)
    image[rows] = np.random.default_rng(1).integers(40, 250, (SIDE - 145, SIDE, 3))
    likely[rows] = 0.0
    found = follow_outline(image, np.maximum(likely, 0.3), outline((158.0, 152.0), (31.5, 31.5)), [np.zeros(2)])
    if found is not None:
        assert found.size == pytest.approx(32.0, rel=0.08)


def test_of_several_motions_the_right_one_is_taken() -> None:
    place, widths = (170.0, 150.0), (30.0, 28.0)
    before = outline((150.0, 150.0), widths)
    moves = [np.zeros(2), np.array([18.0, 0.0]), np.array([-18.0, 0.0])]
    found = follow_outline(picture(place, widths), hand_like(place, widths), before, moves)
    assert found is not None
    np.testing.assert_allclose(found.centre, place, atol=0.3)


def test_a_table_has_no_outline() -> None:
    image = picture((-200.0, -200.0), (20.0, 20.0))
    assert find_outline(image, np.zeros((SIDE, SIDE), np.float32), np.array([160.0, 160.0]), 30.0) is None
    flat = np.full((SIDE, SIDE, 3), 90, np.uint8)
    assert find_outline(flat, np.ones((SIDE, SIDE), np.float32), np.array([160.0, 160.0]), 30.0) is None


def test_a_long_thing_is_no_hand() -> None:
    widths = (60.0, 20.0)
    image = picture((160.0, 160.0), widths)
    found = find_outline(image, hand_like((160.0, 160.0), widths), np.array([160.0, 160.0]), 25.0)
    assert found is None or found.support < 0.6


def test_half_widths_and_mask_are_those_of_the_ellipse() -> None:
    found = outline((100.0, 120.0), (40.0, 20.0))
    assert found.half_widths == pytest.approx((20.0, 40.0))
    assert found.size == pytest.approx(np.sqrt(800.0))
    mask = found.mask((SIDE, SIDE))
    assert mask.sum() == pytest.approx(np.pi * 800, rel=0.02)
    assert mask[120, 138]
    assert not mask[142, 100]
    assert found.mask((SIDE, SIDE), 1.2)[142, 100]


def test_of_two_outlines_that_of_the_size_before_is_likelier() -> None:
    before = outline((0.0, 0.0), (30.0, 30.0))
    same, half = outline((0.0, 0.0), (30.5, 30.0)), outline((0.0, 0.0), (15.0, 15.0))
    assert likelihood(same, before) > likelihood(half, before) + 1
