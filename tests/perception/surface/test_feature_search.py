"""Features found where a rendering shows them, and followed where it does not."""

from dataclasses import replace

import numpy as np

from egophys_core.perception.stages import Masks
from egophys_core.perception.surface.feature_search import Found, RenderedSurface, find_rendered, follow, scene_of
from egophys_core.perception.surface.patch_match import even_contrast
from egophys_core.perception.surface.surface_fit import fitter_of
from egophys_core.perception.surface.surface_render import project
from tests.perception.surface.surface_scene import SIDE, object_at_rest, video

REST = object_at_rest("sheet")
FRAME = video("sheet")[10]
EVENED = even_contrast(FRAME.image)
NOWHERE = np.zeros((SIDE, SIDE), bool)


def scene() -> RenderedSurface:
    fitter = fitter_of(REST.model)
    return scene_of(
        REST.model.triangles, (fitter.skin(REST.model.rest, 1.0), fitter.skin(REST.model.rest, -1.0)), FRAME.view
    )


def expected() -> np.ndarray:
    skin = fitter_of(REST.model).skin(REST.model.rest, 1.0)
    corners = REST.model.mesh.triangles[REST.feature_triangles]
    places = np.einsum("nk,nkd->nd", REST.feature_weights, skin[corners])
    return project(places, FRAME.view.camera_matrix, FRAME.view.world_from_camera)[:, :2]


def test_the_resting_surface_is_found_where_it_is() -> None:
    found = find_rendered(REST.picture, scene(), EVENED, FRAME.masks, 1)
    assert len(found.features) > 0.7 * len(REST.feature_pixels)
    assert len(np.unique(found.features)) == len(found.features)
    away = np.linalg.norm(found.pixels - expected()[found.features], axis=1)
    assert np.median(away) < 0.3
    assert (found.side == 1).all()
    assert (found.sigma > 0).all()


def test_rendered_silhouette_is_the_mask() -> None:
    drawn, true = scene().rendering.silhouette, FRAME.masks.object
    assert (drawn & true).sum() / (drawn | true).sum() > 0.95


def test_nothing_is_found_at_the_hand() -> None:
    hand = NOWHERE.copy()
    hand[:, : SIDE // 2] = True
    masks = Masks(object=FRAME.masks.object & ~hand, hand=hand)
    found = find_rendered(REST.picture, scene(), EVENED, masks, 1)
    assert len(found.features) > 20
    assert found.pixels[:, 0].min() > SIDE // 2


def test_nothing_is_found_without_an_object_or_in_another_picture() -> None:
    nothing = Masks(object=NOWHERE, hand=NOWHERE)
    assert len(find_rendered(REST.picture, scene(), EVENED, nothing, 1).features) == 0
    noise = np.random.default_rng(0).integers(0, 255, EVENED.shape).astype(np.uint8)
    assert len(find_rendered(REST.picture, scene(), noise, FRAME.masks, 1).features) < 0.02 * len(REST.feature_pixels)


def test_the_other_side_of_the_sheet_is_known_as_such() -> None:
    fitter = fitter_of(REST.model)
    turned = REST.model.rest * [-1, 1, 1]
    assert (
        scene_of(REST.model.triangles, (fitter.skin(turned, 1.0), fitter.skin(turned, -1.0)), FRAME.view).side == -1
    ).all()


def test_following_finds_the_same_features_in_the_next_frame() -> None:
    before = find_rendered(REST.picture, scene(), EVENED, FRAME.masks, 1)
    after = video("sheet")[11]
    found = follow(before, EVENED, even_contrast(after.image), after.masks)
    assert len(found.features) > 0.9 * len(before.features)
    assert np.isin(found.features, before.features).all()
    assert (found.sigma > before.sigma.min()).all()


def test_following_nothing_finds_nothing() -> None:
    nothing = find_rendered(REST.picture, scene(), EVENED, Masks(object=NOWHERE, hand=NOWHERE), 1)
    assert len(follow(nothing, EVENED, EVENED, FRAME.masks).features) == 0


def test_surface_behind_the_camera_finds_nothing() -> None:
    behind = REST.model.rest + [0, 0, 5.0]
    away = scene_of(REST.model.triangles, (behind, behind), FRAME.view)
    assert len(find_rendered(REST.picture, away, EVENED, FRAME.masks, 1).features) == 0


def test_without_leaves_out_the_named_ones() -> None:
    found = Found(features=np.array([3, 5, 9]), pixels=np.eye(3)[:, :2], sigma=np.arange(3.0), side=np.ones(3)).without(
        np.array([5, 7])
    )
    np.testing.assert_array_equal(found.features, [3, 9])
    np.testing.assert_array_equal(found.sigma, [0, 2])


def test_masks_of_another_exposure_change_nothing() -> None:
    dim = replace(FRAME, image=(0.6 * FRAME.image).astype(np.uint8))
    found = find_rendered(REST.picture, scene(), even_contrast(dim.image), FRAME.masks, 1)
    assert len(found.features) > 0.65 * len(REST.feature_pixels)
