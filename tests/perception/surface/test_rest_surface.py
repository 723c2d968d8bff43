"""The object at rest, learnt from drawn frames with true poses and masks."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.options import ObjectKind
from egophys_core.perception.stages import View
from egophys_core.perception.surface.rest_surface import rest_object
from egophys_core.perception.surface.surface_fit import fitter_of
from tests.perception.surface.surface_scene import MATRIX, OPTIONS, SIDE, material_of, object_at_rest, surface, video

STILL = video("sheet")[:13]
VIEWS = [each.view for each in STILL]
MASKS = [each.masks.object for each in STILL]


def nowhere() -> np.ndarray:
    return np.zeros((SIDE, SIDE), bool)


def miss(kind: str) -> np.ndarray:
    """[V] metres: distance of the learnt skin from the drawn surface."""
    rest, frame = object_at_rest(kind), video(kind)[object_at_rest(kind).reference]
    skin = fitter_of(rest.model).skin(rest.model.rest, 1.0)[: len(rest.model.mesh.pixels)]
    return np.asarray(np.linalg.norm(surface(frame)[material_of(skin, frame)] - skin, axis=1))


def test_a_sheet_lies_where_it_was_drawn() -> None:
    rest = object_at_rest("sheet")
    assert rest.kind == ObjectKind.SHEET
    assert np.median(miss("sheet")) < 0.001
    assert rest.model.thickness == pytest.approx(0.003, abs=0.001)
    assert rest.residual_px < 0.3
    assert rest.note == ""
    assert rest.reference == 0


def test_a_dome_is_a_solid_of_its_height() -> None:
    rest = object_at_rest("dome")
    assert rest.kind == ObjectKind.SOLID
    assert np.median(miss("dome")) < 0.003
    assert rest.model.rest[:, 2].max() == pytest.approx(0.080, abs=0.004)
    assert len(rest.model.rest) == 2 * len(rest.model.mesh.pixels)


def test_features_lie_in_the_mask_and_on_their_triangles() -> None:
    rest = object_at_rest("sheet")
    x, y = rest.feature_pixels.astype(int).T
    assert MASKS[0][y, x].all()
    corners = rest.model.mesh.pixels[rest.model.mesh.triangles[rest.feature_triangles]]
    np.testing.assert_allclose(np.einsum("nk,nkd->nd", rest.feature_weights, corners), rest.feature_pixels, atol=1e-6)
    assert 0.5 * OPTIONS.queries < len(x) <= OPTIONS.queries


@pytest.mark.parametrize("kind", [ObjectKind.SHEET, ObjectKind.SOLID])
def test_the_user_can_say_what_it_is(kind: ObjectKind) -> None:
    assert rest_object(VIEWS, MASKS, 0.0, replace(OPTIONS, kind=kind)).kind == kind


def test_an_object_that_never_rests_is_noted() -> None:
    moving = video("dome")[24:38]
    rest = rest_object([each.view for each in moving], [each.masks.object for each in moving], 0.0, OPTIONS)
    assert "film it for a second" in rest.note


def test_an_object_that_comes_later_is_learnt_from_there() -> None:
    masks = [nowhere() if index < 4 else mask for index, mask in enumerate(MASKS + MASKS[-4:])]
    views = VIEWS + VIEWS[-4:]
    assert rest_object(views, masks, 0.0, OPTIONS).reference == 4


def test_no_object_is_an_error() -> None:
    with pytest.raises(EpisodeError, match="not in the first views"):
        rest_object(VIEWS, [nowhere()] * len(VIEWS), 0.0, OPTIONS)


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_views_are_an_error(count: int) -> None:
    with pytest.raises(EpisodeError, match=rf"{count} view"):
        rest_object(VIEWS[:count], MASKS[:count], 0.0, OPTIONS)


def test_an_object_of_one_pixel_is_an_error() -> None:
    mask = nowhere()
    mask[200, 150] = True
    with pytest.raises(EpisodeError, match="1 pixels"):
        rest_object(VIEWS, [mask] * len(VIEWS), 0.0, OPTIONS)


def test_an_object_without_texture_stays_finite() -> None:
    plain = [replace(each, image=np.full((SIDE, SIDE, 3), 120, np.uint8)) for each in VIEWS]
    rest = rest_object(plain, MASKS, 0.0, OPTIONS)
    assert np.isfinite(rest.model.rest).all()


def test_a_camera_that_does_not_move_stays_finite() -> None:
    still = [
        View(stamp_ns=k, image=VIEWS[0].image, camera_matrix=MATRIX, world_from_camera=VIEWS[0].world_from_camera)
        for k in range(12)
    ]
    assert np.isfinite(rest_object(still, [MASKS[0]] * 12, 0.0, OPTIONS).model.rest).all()
