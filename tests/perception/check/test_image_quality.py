import cv2
import numpy as np
import pytest

from egophys_core.perception.check.image_quality import blur_px, light_of, trackable
from tests.perception.table_scene import Scene, draw


def squares(blur: tuple[float, float], noise: float) -> np.ndarray:
    """[300, 300, 3]: bright squares on dark ground, blurred along x and y by so many pixels."""
    image = np.full((300, 300), 60.0)
    for x in range(20, 280, 60):
        for y in range(20, 280, 60):
            image[y : y + 30, x : x + 30] = 190
    image = cv2.GaussianBlur(image, (0, 0), sigmaX=blur[0], sigmaY=blur[1])
    image += np.random.default_rng(1).normal(0, noise, image.shape)
    return cv2.cvtColor(image.clip(0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_blur_is_measured_in_pixels_in_the_direction_that_has_more(noise):
    for true in (0.8, 1.5, 2.5):
        assert blur_px(squares((true, true), noise)) == pytest.approx(true, rel=0.2)
    assert blur_px(squares((0.8, 2.5), noise)) == pytest.approx(2.5, rel=0.2)
    assert blur_px(squares((2.5, 0.8), noise)) == pytest.approx(2.5, rel=0.2)


def test_a_pattern_can_be_followed_where_it_changes_in_both_directions_by_more_than_noise():
    rng = np.random.default_rng(2)
    noise = rng.normal(0, 3, (200, 200))
    dots = cv2.GaussianBlur(rng.normal(0, 60, (200, 200)), (0, 0), 2)
    stripes = 20 * np.sin(np.arange(200) / 4)[None] * np.ones((200, 1))

    def share(pattern: np.ndarray) -> float:
        image = (120 + pattern + noise).clip(0, 255).astype(np.uint8)
        return float(trackable(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))[20:-20, 20:-20].mean())

    assert share(np.zeros((200, 200))) < 0.02
    assert share(stripes) < 0.05
    assert share(dots) > 0.95


def test_changes_of_light_are_told_from_the_table_alone():
    gains = {3: 1.4, 6: 0.6}
    scene = Scene(gains=gains, hand_frames=(2, 40))
    drawn = [draw(scene, frame) for frame in (0, 3, 6, 9)]
    covered = [masks.object | masks.hand for _, masks in drawn]
    assert light_of([view for view, _ in drawn], covered) == pytest.approx([1, 1.4, 0.6, 1], rel=0.04)
