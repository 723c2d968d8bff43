"""A lost body is recognised wherever it is, and nothing else is."""

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.perception.stages import Masks
from egophys_core.perception.surface.patch_match import even_contrast
from egophys_core.perception.surface.relocation import landmarks_of, relocated
from tests.perception.surface.surface_scene import SIDE, object_at_rest, video

REST = object_at_rest("dome")
KNOWN = [landmarks_of(REST.picture)]
FRAME = video("dome")[12]
EVENED = even_contrast(FRAME.image)
PLACES = np.einsum("nk,nkd->nd", REST.feature_weights, REST.model.rest[REST.model.triangles[REST.feature_triangles]])


def test_it_is_found_from_wherever_it_was_thought_to_be() -> None:
    turn = Rotation.from_rotvec([0.5, -0.3, 1.2]).as_matrix()
    away = PLACES @ turn.T + [0.3, -0.2, 0.5]
    move = relocated(KNOWN, away, EVENED, FRAME.view, FRAME.masks)
    assert move is not None
    np.testing.assert_allclose(move[:3, :3] @ move[:3, :3].T, np.eye(3), atol=1e-9)
    back = away @ move[:3, :3].T + move[:3, 3]
    assert np.linalg.norm(back - PLACES, axis=1).mean() < 0.01


def test_nothing_is_recognised_where_it_is_not() -> None:
    nowhere = np.zeros((SIDE, SIDE), bool)
    assert relocated(KNOWN, PLACES, EVENED, FRAME.view, Masks(object=nowhere, hand=nowhere)) is None
    table = Masks(object=~FRAME.masks.object, hand=FRAME.masks.object)
    assert relocated(KNOWN, PLACES, EVENED, FRAME.view, table) is None
    flat = np.full_like(EVENED, 128)
    assert relocated(KNOWN, PLACES, flat, FRAME.view, FRAME.masks) is None
    noise = np.random.default_rng(0).integers(0, 255, EVENED.shape).astype(np.uint8)
    assert relocated(KNOWN, PLACES, noise, FRAME.view, FRAME.masks) is None


def test_landmarks_are_named_by_features() -> None:
    (known,) = KNOWN
    assert len(known.features) > 30
    assert known.descriptors.shape == (len(known.features), 128)
    assert known.features.min() >= 0
    assert known.features.max() < len(REST.feature_pixels)
