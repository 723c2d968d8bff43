"""A lost body is recognised wherever it is, and nothing else is."""

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.perception.stages import Masks
from egophys_core.perception.surface.patch_match import even_contrast
from egophys_core.perception.surface.relocation import Recognised, agreeing, landmarks_of, recognised, relocated
from tests.perception.surface.surface_scene import SIDE, object_at_rest, video

REST = object_at_rest("dome")
KNOWN = [landmarks_of(REST.picture)]
FRAME = video("dome")[12]
EVENED = even_contrast(FRAME.image)
PLACES = np.einsum("nk,nkd->nd", REST.feature_weights, REST.model.rest[REST.model.triangles[REST.feature_triangles]])


def test_it_is_found_from_wherever_it_was_thought_to_be() -> None:
    turn = Rotation.from_rotvec([0.5, -0.3, 1.2]).as_matrix()
    away = PLACES @ turn.T + [0.3, -0.2, 0.5]
    move = relocated(recognised(KNOWN, EVENED, FRAME.masks), away, FRAME.view)
    assert move is not None
    np.testing.assert_allclose(move[:3, :3] @ move[:3, :3].T, np.eye(3), atol=1e-9)
    back = away @ move[:3, :3].T + move[:3, 3]
    assert np.linalg.norm(back - PLACES, axis=1).mean() < 0.01


def test_nothing_is_recognised_where_it_is_not() -> None:
    def pose(evened: np.ndarray, masks: Masks) -> np.ndarray | None:
        return relocated(recognised(KNOWN, evened, masks), PLACES, FRAME.view)

    nowhere = np.zeros((SIDE, SIDE), bool)
    assert pose(EVENED, Masks(object=nowhere, hand=nowhere)) is None
    assert pose(EVENED, Masks(object=~FRAME.masks.object, hand=FRAME.masks.object)) is None
    assert pose(np.full_like(EVENED, 128), FRAME.masks) is None
    noise = np.random.default_rng(0).integers(0, 255, EVENED.shape).astype(np.uint8)
    assert pose(noise, FRAME.masks) is None


def test_landmarks_of_a_sheet_count_where_their_neighbours_agree() -> None:
    generator = np.random.default_rng(0)
    at_rest = generator.uniform(0, 300, (60, 2))
    turn = np.array([[0.8, -0.5], [0.4, 0.7]])
    pixels = at_rest @ turn.T + 80
    wrong = np.arange(60) % 7 == 0
    pixels[wrong] = generator.uniform(0, 300, (wrong.sum(), 2))
    found = agreeing(Recognised(features=np.arange(60), pixels=pixels), at_rest)
    assert np.isin(found.features, np.flatnonzero(wrong)).mean() < 0.05
    assert np.isin(np.flatnonzero(~wrong), found.features).mean() > 0.7
    few = Recognised(features=np.arange(5), pixels=at_rest[:5])
    assert len(agreeing(few, at_rest).features) == 0


def test_landmarks_are_named_by_features() -> None:
    (known,) = KNOWN
    assert len(known.features) > 30
    assert known.descriptors.shape == (len(known.features), 128)
    assert known.features.min() >= 0
    assert known.features.max() < len(REST.feature_pixels)
