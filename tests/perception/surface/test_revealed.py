"""Pictures of what a solid shows for the first time."""

from dataclasses import replace

import numpy as np

from egophys_core.perception.stages import Masks
from egophys_core.perception.surface.feature_search import RenderedSurface, find_rendered, scene_of
from egophys_core.perception.surface.patch_match import even_contrast
from egophys_core.perception.surface.revealed import revealed
from tests.perception.surface.surface_scene import SIDE, object_at_rest, video

REST = object_at_rest("dome")
FRAME = video("dome")[REST.reference]
EVENED = even_contrast(FRAME.image)
NOWHERE = np.zeros((SIDE, SIDE), bool)


def scene() -> RenderedSurface:
    return scene_of(REST.model.triangles, (REST.model.rest, REST.model.rest), FRAME.view)


def half_known() -> np.ndarray:
    """[F, 3, 2]: the reference picture, as if it showed the left half only."""
    corners = REST.picture.corners.copy()
    corners[np.nan_to_num(corners[:, :, 0]).mean(axis=1) > np.median(REST.feature_pixels[:, 0])] = np.nan
    return corners


def test_what_the_reference_view_shows_is_not_new() -> None:
    assert revealed([REST.picture], scene(), EVENED, FRAME.masks) is None


def test_the_other_half_is_new_and_found_in_its_own_picture() -> None:
    known = replace(REST.picture, corners=half_known())
    new = revealed([known], scene(), EVENED, FRAME.masks)
    assert new is not None
    assert new.first == len(known.feature_pixels)
    assert len(new.feature_pixels) > 30
    assert np.isnan(known.corners[new.feature_triangles]).all()
    assert np.isfinite(new.corners[new.feature_triangles]).all()
    np.testing.assert_allclose(new.feature_weights.sum(axis=1), 1)
    found = find_rendered(new, scene(), EVENED, FRAME.masks, 1)
    assert len(found.features) > 0.5 * len(new.feature_pixels)
    away = np.linalg.norm(found.pixels - new.feature_pixels[found.features - new.first], axis=1)
    assert np.median(away) < 0.1
    assert revealed([known, new], scene(), EVENED, FRAME.masks) is None


def test_nothing_is_learnt_of_a_hand_or_without_an_object() -> None:
    known = replace(REST.picture, corners=half_known())
    everywhere = Masks(object=FRAME.masks.object, hand=~NOWHERE)
    assert revealed([known], scene(), EVENED, everywhere) is None
    assert revealed([known], scene(), EVENED, Masks(object=NOWHERE, hand=NOWHERE)) is None
