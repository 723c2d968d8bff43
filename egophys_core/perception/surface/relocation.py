"""Finds a lost solid again, wherever it is in the view: its pictures' features by their descriptors, then its pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from egophys_core.perception.stages import Masks, View
from egophys_core.perception.surface.feature_search import may_show
from egophys_core.perception.surface.surface_mesh import SurfaceTexture

NEAREST_PX = 3.0
"""Pixels from a landmark to the feature of the picture that stands for it."""

RATIO = 0.8
"""A landmark is recognised if the best match is nearer than this share of the second best (Lowe 2004)."""

MISSED_PX = 4.0
"""Pixels: matches farther from where a pose has them are wrong; the body may have deformed by some."""

FEWEST_MATCHES = 12
"""Right matches with which a pose is believed; six agree with one by construction."""

TRIALS = 300


@dataclass(frozen=True, kw_only=True)
class Landmarks:
    """What can be recognised in pictures of a body."""

    features: np.ndarray
    """[L] int: the feature nearest to each."""
    descriptors: np.ndarray
    """[L, 128] float32."""


def landmarks_of(texture: SurfaceTexture) -> Landmarks:
    """Those near the features of a picture."""
    pixels, descriptors = _described(texture.image)
    if not len(pixels) or not len(texture.feature_pixels):
        return Landmarks(features=np.zeros(0, int), descriptors=np.zeros((0, 128), np.float32))
    distance, nearest = cKDTree(texture.feature_pixels).query(pixels)
    near = distance < NEAREST_PX
    return Landmarks(features=texture.first + nearest[near], descriptors=descriptors[near])


def relocated(
    known: Sequence[Landmarks], places: np.ndarray, evened: np.ndarray, view: View, masks: Masks
) -> np.ndarray | None:
    """[4, 4]: where the body is in the world, from its place at rest; None if it is not recognised.

    Args:
        known: of all its pictures.
        places: [N, 3] metres, frame world: the features at rest.
        evened: [S, S] uint8: the view with even contrast.
        view: its pose is known.
        masks: of the view.
    """
    pixels, descriptors = _described(evened)
    x, y = np.rint(pixels).astype(int).T
    shown = (masks.object & may_show(masks))[y, x]
    pixels, descriptors = pixels[shown], descriptors[shown]
    features = np.concatenate([each.features for each in known])
    if len(pixels) < FEWEST_MATCHES or len(features) < 2:
        return None
    pairs = cv2.BFMatcher().knnMatch(descriptors, np.vstack([each.descriptors for each in known]), k=2)
    good = [best for best, second in pairs if best.distance < RATIO * second.distance]
    if len(good) < FEWEST_MATCHES:
        return None
    at_rest = places[features[[match.trainIdx for match in good]]]
    found, rotation, shift, right = cv2.solvePnPRansac(
        at_rest,
        pixels[[match.queryIdx for match in good]],
        view.camera_matrix,
        None,
        iterationsCount=TRIALS,
        reprojectionError=MISSED_PX,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not found or right is None or len(right) < FEWEST_MATCHES:
        return None
    camera_from_rest = np.eye(4)
    camera_from_rest[:3, :3], camera_from_rest[:3, 3] = cv2.Rodrigues(rotation)[0], shift[:, 0]
    return np.asarray(view.world_from_camera @ camera_from_rest)


def _described(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[L, 2] pixels of landmarks and their descriptors [L, 128]."""
    keys, descriptors = cv2.SIFT.create(contrastThreshold=0.02).detectAndCompute(image, None)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    return np.array([key.pt for key in keys]), descriptors
