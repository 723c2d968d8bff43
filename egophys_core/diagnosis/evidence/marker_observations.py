"""Observations of an object with a few markers: followed freely, a marker a patch, in short blocks of time.

A clamped beam or a cable is not chaotic: what its twin lacks shows best in a free rollout, which no nudging towards
the markers hides. Markers are measured to hundredths of a millimetre at 100 Hz, so a block need not outlast noise.
"""

import numpy as np
from scipy.sparse import csr_matrix

from egophys_core.diagnosis.evidence.residuals import FEWEST_IN_BLOCK
from egophys_core.diagnosis.observed_tracks import ObservedTracks, smoothed
from egophys_core.diagnosis.tracked_episode import BLOCK_S, FREE, TrackedEpisode, block_numbers
from egophys_core.errors import DiscrepancyError
from egophys_core.observation import AnyEpisode, FitProblem, observe_episode, place_model
from egophys_core.observation.clamps import stands_still
from egophys_core.twin import Twin

RING_DOWN_BLOCK_S = 0.04
"""Seconds of a block of a ring-down in a still clamp: a quarter of a period of 6 Hz. What hands move oscillates as
slowly as they do, and what is off in one short block is off in the next: a cable that lacks nothing had a structure of
139."""

LEAST_RECORD_S = 0.5
"""Seconds below which markers show less than an oscillation."""


def observe_markers(twin: Twin, episode: AnyEpisode, *, load: float = 0.0) -> TrackedEpisode:
    """Place a twin of markers in an episode.

    Args:
        load: N, the weight of what hangs at the free end.

    Raises:
        EpisodeError: other markers or held points than the twin has.
        DiscrepancyError: a record too short to say anything.
    """
    observed = observe_episode(episode, load=load)
    problem = place_model(twin.model, twin.grasp, observed)
    times = problem.episode.times
    if times[-1] < LEAST_RECORD_S:
        raise DiscrepancyError(
            f"{episode.name}: {times[-1]:.2f} s after the object first turned back say nothing of what a twin lacks; "
            "record some oscillations"
        )
    count = problem.episode.points.shape[1]
    mounted = stands_still(problem.controls.positions)
    block = max(RING_DOWN_BLOCK_S if mounted else BLOCK_S, FEWEST_IN_BLOCK * float(np.median(np.diff(times))))
    return TrackedEpisode(
        observed=observed,
        problem=problem,
        tracks=_tracks(problem),
        rest=problem.episode.points[0].astype(np.float64),
        patches=np.arange(count),
        blocks=block_numbers(times, block),
        rate=FREE,
        mounted=mounted,
    )


def _tracks(problem: FitProblem) -> ObservedTracks:
    """The markers, each at a node of its own."""
    points = problem.episode.points.astype(np.float64)
    smooth, velocities = smoothed(points, problem.episode.times)
    count = points.shape[1]
    return ObservedTracks(
        positions=points,
        smooth=smooth,
        velocities=velocities,
        weights=csr_matrix((np.ones(count), (np.arange(count), problem.bound)), shape=(count, len(problem.start))),
    )
