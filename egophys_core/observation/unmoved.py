"""Why no hand moves the object of an episode: a sentence that says what was seen and what to do."""

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.episode import Episode
from egophys_core.observation.hand_scene import NEAR_HAND

AT_ONCE = 100
"""Frames of which the distance between hands and points is looked up."""


def why_unmoved(episode: Episode) -> str:
    """What to say of an episode in which no hand has contact."""
    if episode.contact is not None:
        return "no hand holds the object: the field contact of its controllers is 0 in all frames; check who sets it"
    nearest = _nearest(episode)
    if nearest > NEAR_HAND:
        return (
            f"no hand moves the object: none ever comes nearer to a point of it than {nearest:.2f} m; check that "
            "object and controller points are in the same frame and unit"
        )
    return (
        f"no hand moves the object (no points within {NEAR_HAND} m of one come along with it); "
        "check that object and controller points are in the same frame and unit"
    )


def _nearest(episode: Episode) -> float:
    """Metres between hands and points where they are nearest to each other."""
    found = []
    for frame in range(0, episode.frames, max(1, episode.frames // AT_ONCE)):
        points = episode.points[frame, episode.visible[frame]]
        if len(points):
            found.append(float(cKDTree(points).query(episode.controllers[frame])[0].min()))
    return min(found, default=np.inf)
