"""J and F of masks against cases counted by hand on squared paper."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from egophys_core.errors import EpisodeError
from egophys_core.evaluation import mask_scores
from egophys_core.evaluation.masks import contour, contour_accuracy, region_similarity

SHAPE = (60, 80)
"""Diagonal 100 pixels: the tolerance is ceil(0.8) = 1."""

PAIRS = st.integers(1, 12).flatmap(
    lambda side: st.tuples(*[hnp.arrays(bool, (side, side + 1)), hnp.arrays(bool, (side, side + 1))])
)


def box(top: int, left: int, height: int, width: int, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    mask = np.zeros(shape, bool)
    mask[top : top + height, left : left + width] = True
    return mask


def reference_contour_accuracy(predicted: np.ndarray, truth: np.ndarray) -> float:
    """The definition with discs drawn pixel by pixel, without distances from a tree."""
    radius = int(np.ceil(0.008 * np.linalg.norm(truth.shape)))

    def edge(mask):
        pixels = set()
        height, width = mask.shape
        for y, x in np.ndindex(height, width):
            below, right = min(y + 1, height - 1), min(x + 1, width - 1)
            if any(mask[y, x] != mask[other] for other in ((y, right), (below, x), (below, right))):
                pixels.add((y, x))
        return pixels

    def near(pixel, pixels):
        return any((pixel[0] - y) ** 2 + (pixel[1] - x) ** 2 <= radius**2 for y, x in pixels)

    one, other = edge(predicted), edge(truth)
    if not one or not other:
        return float(one == other)
    precision = sum(near(pixel, other) for pixel in one) / len(one)
    recall = sum(near(pixel, one) for pixel in other) / len(other)
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def test_region_similarity_is_intersection_over_union():
    # 10 x 10 boxes, 5 columns apart: 50 pixels in both, 150 in either.
    assert region_similarity(box(10, 10, 10, 10), box(10, 15, 10, 10)) == pytest.approx(1 / 3)


def test_contour_lies_up_and_left_of_the_edge():
    mask = box(1, 1, 2, 2, (4, 4))
    drawn = ["".join("#" if each else "." for each in row) for row in contour(mask)]
    assert drawn == ["###.", "#.#.", "###.", "...."]


def test_border_of_the_image_is_no_contour():
    # The left half is object: one column of contour, in the last row too, none around the border.
    drawn = contour(box(0, 0, 4, 2, (4, 4)))
    assert np.argwhere(drawn).tolist() == [[0, 1], [1, 1], [2, 1], [3, 1]]
    assert not contour(np.ones((5, 5), bool)).any()


@pytest.mark.parametrize(("shift", "expected"), [(0, 1.0), (1, 1.0), (40, 0.0)])
def test_contour_accuracy_forgives_one_pixel_in_a_diagonal_of_100(shift, expected):
    assert contour_accuracy(box(10, 10, 10, 10), box(10, 10 + shift, 10, 10)) == expected


def test_contour_accuracy_two_pixels_off_counted_by_hand():
    # Contours are rings of 11 x 11, 40 pixels; the other ring is 2 columns to the right, tolerance 1.
    # Of the first ring the upper and lower row have columns 0 .. 10, and 1 .. 10 are within 1 of the other's 2 .. 12:
    # 20 pixels. Of the 9 inner pixels of the left column, 2 away from the other's, none is near; those of
    # the right column, column 10, are 2 from the other's right column, but the first and last of them
    # are 1 below or above the other's rows: 2 pixels. So 22 of 40, and the same the other way round.
    assert contour_accuracy(box(10, 10, 10, 10), box(10, 12, 10, 10)) == pytest.approx(22 / 40)


def test_precision_and_recall_differ():
    # Two boxes are predicted, one is true: precision 1/2, recall 1, F = 2/3.
    truth = box(10, 10, 10, 10)
    assert contour_accuracy(truth | box(40, 40, 10, 10), truth) == pytest.approx(2 / 3)


def test_tolerance_grows_with_the_image():
    # 600 x 800 pixels: ceil(8.0) = 8 forgive 8 pixels, not 9.
    truth = box(100, 100, 200, 200, (600, 800))
    assert contour_accuracy(box(100, 108, 200, 200, (600, 800)), truth) == 1.0
    assert contour_accuracy(box(100, 109, 200, 200, (600, 800)), truth) < 1.0


def test_empty_masks():
    empty, full = np.zeros(SHAPE, bool), box(10, 10, 10, 10)
    assert (region_similarity(empty, empty), contour_accuracy(empty, empty)) == (1.0, 1.0)
    assert (region_similarity(empty, full), contour_accuracy(empty, full)) == (0.0, 0.0)
    assert (region_similarity(full, empty), contour_accuracy(full, empty)) == (0.0, 0.0)


def test_scores_of_a_video_are_means_over_its_frames_and_may_be_streamed():
    truth = [box(10, 10, 10, 10)] * 2
    predicted = [box(10, 10, 10, 10), box(40, 40, 10, 10)]
    scores = mask_scores(iter(predicted), (mask for mask in truth))
    assert scores.region_per_frame.tolist() == scores.contour_per_frame.tolist() == [1.0, 0.0]
    assert (scores.region, scores.contour) == (0.5, 0.5)
    assert np.isnan([mask_scores([], []).region, mask_scores([], []).contour]).all()


def test_bad_masks_are_refused():
    mask = np.zeros(SHAPE, bool)
    with pytest.raises(EpisodeError, match=r"predicted \(60, 80\) and true \(30, 40\)"):
        mask_scores([mask], [mask[::2, ::2]])
    with pytest.raises(EpisodeError, match="true uint8"):
        mask_scores([mask], [mask.astype(np.uint8)])
    with pytest.raises(EpisodeError, match="true masks end before frame 1"):
        mask_scores([mask, mask], [mask])
    with pytest.raises(EpisodeError, match="predicted masks end before frame 0"):
        mask_scores([], [mask])


@given(PAIRS)
def test_contour_accuracy_is_that_of_drawn_discs(masks):
    assert contour_accuracy(*masks) == pytest.approx(reference_contour_accuracy(*masks))


@given(PAIRS)
def test_scores_are_within_0_and_1_symmetric_and_1_for_the_truth(masks):
    one, other = masks
    for measure in (region_similarity, contour_accuracy):
        assert 0 <= measure(one, other) <= 1
        assert measure(one, other) == pytest.approx(measure(other, one))
        assert measure(one, one) == 1.0
