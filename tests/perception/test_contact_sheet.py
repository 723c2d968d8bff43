import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.contact_sheet import EvenSample, contact_sheet


@pytest.mark.parametrize("count", [0, 1, 5, 12, 13, 47, 48, 49, 180, 5000])
def test_sample_is_even_and_bounded(count):
    sample: EvenSample[int] = EvenSample(12)
    for item in range(count):
        sample.add(item)
        assert len(sample._kept) <= 48
    items = sample.items()
    assert len(items) == min(12, count)
    assert items == sorted(set(items))
    if count:
        assert items[0] == 0
        assert count - 1 - items[-1] < max(1, count / 12)
    steps = np.diff(items)
    if count > 48:
        assert steps.max() <= 1.51 * steps.min()


def test_sheet_shows_the_pictures_row_by_row():
    pictures = [np.full((40, 60, 3), 20 * index + 10, np.uint8) for index in range(5)]
    sheet = contact_sheet(pictures, title="five", columns=3)
    cells = sheet[64:]
    assert cells.shape == (2 * 44 + 4, 3 * 64 + 4, 3)
    for index, picture in enumerate(pictures):
        y, x = 4 + index // 3 * 44, 4 + index % 3 * 64
        assert (cells[y : y + 40, x : x + 60] == picture).all()
    assert (cells[48:88, 132:192] == 40).all(), "the sixth cell is empty"


def test_wide_pictures_are_shrunk():
    assert contact_sheet([np.zeros((518, 1036, 3), np.uint8)] * 12, title="").shape[1] < 2400


def test_sheet_needs_pictures_of_one_size():
    with pytest.raises(EpisodeError, match="none"):
        contact_sheet([], title="")
    with pytest.raises(EpisodeError, match=r"\(4, 5, 3\).*\(4, 6, 3\)"):
        contact_sheet([np.zeros((4, 5, 3), np.uint8), np.zeros((4, 6, 3), np.uint8)], title="")
