"""Finds a lost object again, wherever it is in the view: its pictures' features by their descriptors.

These tell the pose of a solid. Those of a sheet are right where their neighbours agree.
"""

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

NEIGHBOURS = 6
"""Landmarks by which one of a sheet is judged."""

SLACK_PX, DISTORTION = 10.0, 0.6
"""Pixels, and share of the distance of its neighbours at rest, by which it may have moved otherwise than they."""


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


@dataclass(frozen=True, kw_only=True)
class Recognised:
    """Landmarks that were found in a view."""

    features: np.ndarray
    """[M] int: the feature that each stands for."""
    pixels: np.ndarray
    """[M, 2]: x and y."""


def recognised(known: Sequence[Landmarks], evened: np.ndarray, masks: Masks) -> Recognised:
    """Landmarks of all pictures in a view, some of them wrong.

    Args:
        known: of all pictures.
        evened: [S, S] uint8: the view with even contrast.
        masks: of the view.
    """
    pixels, descriptors = _described(evened)
    x, y = np.rint(pixels).astype(int).T
    shown = (masks.object & may_show(masks))[y, x]
    pixels, descriptors = pixels[shown], descriptors[shown]
    features = np.concatenate([each.features for each in known])
    if not len(pixels) or len(features) < 2:
        return Recognised(features=np.zeros(0, int), pixels=np.zeros((0, 2)))
    pairs = cv2.BFMatcher().knnMatch(descriptors, np.vstack([each.descriptors for each in known]), k=2)
    good = [best for best, second in pairs if best.distance < RATIO * second.distance]
    return Recognised(
        features=features[[match.trainIdx for match in good]], pixels=pixels[[match.queryIdx for match in good]]
    )


def relocated(found: Recognised, places: np.ndarray, view: View) -> np.ndarray | None:
    """[4, 4]: where a body is in the world, from its place at rest; None if it is not recognised.

    Args:
        found: its landmarks.
        places: [N, 3] metres, frame world: the features at rest.
        view: its pose is known.
    """
    if len(found.features) < FEWEST_MATCHES:
        return None
    done, rotation, shift, right = cv2.solvePnPRansac(
        places[found.features],
        found.pixels,
        view.camera_matrix,
        None,
        iterationsCount=TRIALS,
        reprojectionError=MISSED_PX,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not done or right is None or len(right) < FEWEST_MATCHES:
        return None
    camera_from_rest = np.eye(4)
    camera_from_rest[:3, :3], camera_from_rest[:3, 3] = cv2.Rodrigues(rotation)[0], shift[:, 0]
    return np.asarray(view.world_from_camera @ camera_from_rest)


def agreeing(found: Recognised, at_rest: np.ndarray) -> Recognised:
    """Those landmarks of a sheet that have moved as most of their neighbours at rest have.

    Args:
        found: some of them are wrong.
        at_rest: [N, 2] pixels: the features in the picture at rest.
    """
    if len(found.features) < FEWEST_MATCHES:
        return Recognised(features=np.zeros(0, int), pixels=np.zeros((0, 2)))
    before = at_rest[found.features]
    moved = found.pixels - before
    away, near = cKDTree(before).query(before, k=NEIGHBOURS + 1)
    off = np.linalg.norm(moved - np.median(moved[near[:, 1:]], axis=1), axis=1)
    right = off < np.maximum(SLACK_PX, DISTORTION * away[:, 1:].mean(axis=1))
    return Recognised(features=found.features[right], pixels=found.pixels[right])


def _described(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[L, 2] pixels of landmarks and their descriptors [L, 128]."""
    keys, descriptors = cv2.SIFT.create(contrastThreshold=0.02).detectAndCompute(image, None)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    return np.array([key.pt for key in keys]), descriptors
