"""Patches found in another image: sub-pixel shifts, exposure, and places where nothing can be found."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from egophys_core.perception.surface.patch_match import LOST_PX, even_contrast, likeness, match

SIZE = 160


def picture(seed: int = 0) -> np.ndarray:
    """[160, 160] float: smooth random texture, known between its pixels too."""
    noise = np.random.default_rng(seed).normal(size=(SIZE, SIZE))
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.8)
    return np.asarray(128 + 45 * smooth / smooth.std())


def as_image(values: np.ndarray) -> np.ndarray:
    return np.repeat(values.clip(0, 255).round().astype(np.uint8)[..., None], 3, axis=2)


def places() -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(30, 131, 10), np.arange(30, 131, 10)), axis=-1).reshape(-1, 2).astype(float)


def shifted(shift: tuple[float, float]) -> np.ndarray:
    return np.asarray(ndimage.shift(picture(), (shift[1], shift[0]), order=5, mode="reflect"))


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.7), (2.5, 1.25), (-6.4, 5.1)])
def test_shift_is_found_to_a_twentieth_of_a_pixel(shift: tuple[float, float]) -> None:
    source, target = even_contrast(as_image(picture())), even_contrast(as_image(shifted(shift)))
    found = match(source, target, places())
    assert (found.returned < LOST_PX).mean() > 0.95
    error = found.pixels - places() - shift
    good = found.returned < LOST_PX
    np.testing.assert_allclose(error[good].mean(axis=0), 0, atol=0.05)
    assert np.sqrt((error[good] ** 2).mean()) < 0.05


def test_a_guess_reaches_farther_than_the_search_alone() -> None:
    shift = (40.0, 0.0)
    source, target = even_contrast(as_image(picture())), even_contrast(as_image(shifted(shift)))
    some = places()[places()[:, 0] < 100]
    with_guess = match(source, target, some, guess=some + [38, 1], levels=1)
    assert np.median(np.linalg.norm(with_guess.pixels - some - shift, axis=1)) < 0.05
    assert (match(source, target, some, levels=1).returned < LOST_PX).mean() < 0.5


@pytest.mark.parametrize(("gain", "offset"), [(0.5, 0), (0.8, 30), (1.2, -20)])
def test_exposure_drops_out(gain: float, offset: float) -> None:
    calm = 128 + 0.5 * (picture() - 128)
    source, target = even_contrast(as_image(calm)), even_contrast(as_image(gain * calm + offset))
    assert np.abs(source.astype(float) - target)[20:-20, 20:-20].mean() < 6
    found = match(source, target, places())
    assert np.linalg.norm(found.pixels - places(), axis=1).max() < 0.1


def test_a_shading_across_the_image_drops_out() -> None:
    calm = 60 + 0.4 * (picture() - 128)
    ramp = np.linspace(0.7, 1.6, SIZE)[None]
    source, target = even_contrast(as_image(calm)), even_contrast(as_image(calm * ramp))
    assert likeness(source, places(), target, places()).min() > 0.95


def test_noise_of_a_plain_image_is_not_amplified() -> None:
    plain = 128 + np.random.default_rng(0).normal(0, 0.5, (SIZE, SIZE))
    assert even_contrast(as_image(plain)).std() < 15


def test_another_picture_is_not_found() -> None:
    source, target = even_contrast(as_image(picture(0))), even_contrast(as_image(picture(5)))
    found = match(source, target, places())
    alike = likeness(source, places(), target, found.pixels)
    assert ((found.returned < LOST_PX) & (alike > 0.6)).mean() < 0.05


def test_likeness_is_one_for_itself_and_minus_one_for_the_negative() -> None:
    grey = as_image(picture())[..., 0]
    np.testing.assert_allclose(likeness(grey, places(), grey, places()), 1, atol=1e-4)
    np.testing.assert_allclose(likeness(grey, places(), 255 - grey, places()), -1, atol=1e-4)


def test_likeness_of_plain_patches_is_nothing() -> None:
    plain = np.full((SIZE, SIZE), 80, np.uint8)
    np.testing.assert_allclose(likeness(plain, places(), as_image(picture())[..., 0], places()), 0, atol=1e-3)


def test_no_places_find_nothing() -> None:
    grey = as_image(picture())[..., 0]
    found = match(grey, grey, np.zeros((0, 2)))
    assert found.pixels.shape == (0, 2)
    assert likeness(grey, np.zeros((0, 2)), grey, found.pixels).shape == (0,)


def test_places_outside_are_lost() -> None:
    grey = as_image(picture())[..., 0]
    outside = np.array([[-500.0, 20], [20, 1e4], [1e6, -1e6]])
    found = match(grey, grey, outside)
    assert not (found.returned < LOST_PX).any()


def test_black_image_stays_grey_and_finite() -> None:
    assert (even_contrast(np.zeros((SIZE, SIZE, 3), np.uint8)) == 128).all()
