"""Where points of the table are seen in two frames each: what a tracker has gathered, for the fit of the poses."""

import numpy as np

from egophys_core.perception.camera.dominant_plane import PlaneObservation, PlaneTracker
from egophys_core.perception.camera.plane_bundle import Bundle, Link

_OFF_PLANE = 2.5
"""Times the median: points whose residuals over all frames are larger are taken for points off the plane."""
_ON_PLANE_SHARE = 0.8


def plane_links(tracker: PlaneTracker, tied: np.ndarray, inverse: np.ndarray) -> list[Link]:
    """What a tracker has seen of the plane, with directions for pixels and indices into `tied` for frames.

    Args:
        tracker: through with the frames.
        tied: [K] int, increasing: the frames it has tied.
        inverse: [3, 3] inverse of K.
    """

    def flat(pixels: np.ndarray) -> np.ndarray:
        return pixels.astype(np.float64) @ inverse[:2, :2].T + inverse[:2, 2]

    links = []
    for each in _of_plane(tracker):
        source = flat(tracker.keyframes[each.keyframe].points[each.points])
        links.append(
            Link(
                source=int(np.searchsorted(tied, each.keyframe)),
                target=int(np.searchsorted(tied, each.frame)),
                points=each.points,
                rays=np.column_stack([source, np.ones(len(source))]),
                flat=flat(each.pixels),
            )
        )
    return links


def without_outliers(links: list[Link], bundle: Bundle) -> list[Link]:
    """Links without points of larger residuals than others throughout: they are a little off the plane."""
    largest = 1 + max(int(link.points.max(initial=0)) for link in links)
    keys = np.concatenate([link.source * largest + link.points.astype(int) for link in links])
    numbers = np.unique(keys, return_inverse=True)[1]
    square = np.minimum(np.concatenate(bundle.residuals), 1.0) ** 2
    rms = np.sqrt(np.bincount(numbers, square) / np.bincount(numbers))
    good = rms <= _OFF_PLANE * np.median(rms)
    ends = np.cumsum([len(link.points) for link in links])[:-1]
    kept = np.split(good[numbers], ends)
    return [
        Link(
            source=link.source,
            target=link.target,
            points=link.points[keep],
            rays=link.rays[keep],
            flat=link.flat[keep],
        )
        for link, keep in zip(links, kept, strict=True)
    ]


def _of_plane(tracker: PlaneTracker) -> list[PlaneObservation]:
    """Observations of those points only that are on the plane in most frames: what was moved later is not the table."""
    kept = []
    for observation in tracker.observations:
        key = tracker.keyframes[observation.keyframe]
        good = (key.on_plane >= _ON_PLANE_SHARE * key.tracked)[observation.points]
        points, pixels = observation.points[good], observation.pixels[good]
        kept.append(
            PlaneObservation(frame=observation.frame, keyframe=observation.keyframe, points=points, pixels=pixels)
        )
    return kept
