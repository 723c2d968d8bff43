"""Local contrast: printed cloth against smooth skin."""

import numpy as np

from egophys_core.perception.masks.texture_model import TextureModel, texture_codes

SIDE = 120


def image(grey: np.ndarray) -> np.ndarray:
    """[SIDE, SIDE, 3] uint8 with the noise of a camera."""
    noise = np.random.default_rng(0).normal(0, 1.5, (SIDE, SIDE, 3))
    return (np.asarray(grey, float)[..., None] + noise).clip(0, 255).astype(np.uint8)


def shaded(middle: float) -> np.ndarray:
    """[SIDE, SIDE] grey that falls off slowly, as on a forearm."""
    return middle + 50 * np.sin(np.linspace(0, np.pi, SIDE))[:, None] * np.ones(SIDE)


def printed() -> np.ndarray:
    """[SIDE, SIDE] grey of a print 6 pixels fine."""
    y, x = np.mgrid[:SIDE, :SIDE] // 3
    return 120 + 40.0 * ((x + y) % 2)


def test_smooth_is_told_from_printed_at_every_brightness() -> None:
    smooth, printed_codes = texture_codes(image(shaded(60))), texture_codes(image(printed()))
    of_skin, of_cloth = TextureModel(), TextureModel()
    of_skin.learn(smooth.ravel())
    of_cloth.learn(printed_codes.ravel())
    brighter = texture_codes(image(shaded(150)))
    for codes, right, wrong in ((brighter, of_skin, of_cloth), (printed_codes, of_cloth, of_skin)):
        is_right = right.log_likelihood(codes) > wrong.log_likelihood(codes) + 0.5
        assert is_right.mean() > 0.98


def test_rims_and_creases_are_no_texture() -> None:
    plain, print_codes = texture_codes(image(shaded(60))), texture_codes(image(printed()))
    rims = shaded(60)
    rims[:, 40:] += 60
    rims[60:63] -= 20
    assert texture_codes(image(rims)).max() <= plain.max() + 2 < print_codes.min()
    # A broad stripe of print is one.
    stripe = shaded(60)
    stripe[40:80] = printed()[40:80]
    assert texture_codes(image(stripe))[50:70].min() >= print_codes.min()


def test_a_model_that_knows_nothing_says_nothing() -> None:
    model = TextureModel()
    codes = texture_codes(image(printed()))
    assert not model.log_likelihood(codes).any()
    model.learn(codes[:0].ravel())
    assert not model.log_likelihood(codes).any()


def test_later_frames_change_what_was_learnt_slowly() -> None:
    smooth, rough = np.zeros(500, np.int32), np.full(500, 8, np.int32)
    model = TextureModel()
    model.learn(smooth)
    first = model.log_likelihood(np.array([0, 8]))
    model.learn(rough, rate=0.1)
    second = model.log_likelihood(np.array([0, 8]))
    assert second[0] > second[1] > first[1]
    for _ in range(60):
        model.learn(rough, rate=0.1)
    assert model.log_likelihood(np.array([8]))[0] > model.log_likelihood(np.array([0]))[0]
