"""A tracked episode: a recording prepared for one twin, its tracks in patches of the object and blocks of time."""

from dataclasses import dataclass

import numpy as np

from egophys_core.diagnosis.observed_tracks import ObservedTracks, observed_tracks
from egophys_core.episode import Episode
from egophys_core.geometry import farthest_points
from egophys_core.observation import AnyEpisode, FitProblem, ObservedEpisode, observe_episode, prepare
from egophys_core.simulation import Controls
from egophys_core.twin import ObjectModel

FREE = 0.0
"""w of a free rollout, which is not nudged."""

RATE = 5.0
"""w, 1/s: what the twin lacks shows over the last fifth of a second or so (docs/notes/discrepancy.md)."""

BLOCK_S = 0.2
"""Seconds in a block of time."""

PATCHES = 12
"""Patches of the object, of about equally many tracks."""

LEAST_SCALE, LEAST_SCALE_OF_MARKERS = 1e-3, 2e-4
"""Metres: no twin is better than this, and smaller residuals are no evidence. A ring-down in a clamp is not chaotic,
and its markers have hardly any noise."""


@dataclass(frozen=True, kw_only=True)
class TrackedEpisode:
    """An episode prepared for observers of one twin: its tracks, in patches and blocks of time."""

    observed: ObservedEpisode
    problem: FitProblem
    tracks: ObservedTracks
    rest: np.ndarray
    """[P, 3] metres, the tracks before hands move the object."""
    patches: np.ndarray
    """[P] patch of each track."""
    blocks: np.ndarray
    """[T - touched] block of each frame from the first contact on."""
    rate: float = RATE
    """w of its observers, 1/s; 0 for free rollouts."""
    mounted: bool = False
    """Whether a clamp holds it that stands still, and was set up anew for this record."""

    @property
    def episode(self) -> Episode:
        """What was observed."""
        return self.problem.episode

    @property
    def touched(self) -> int:
        """First frame of contact, at which observers start: what is at rest stays so until it is touched, whatever its
        twin would do."""
        return self.observed.touched

    @property
    def free(self) -> bool:
        """Whether nothing nudges the twin to the tracks: what swings in the air is not chaotic, and shows more so."""
        return self.rate == 0

    @property
    def least_scale(self) -> float:
        """Metres, the least size of residuals that are evidence."""
        return LEAST_SCALE_OF_MARKERS if self.observed.is_sparse else LEAST_SCALE

    @property
    def block_count(self) -> int:
        """Number of blocks B."""
        return int(self.blocks.max()) + 1

    def controls(self) -> Controls:
        """The hands from where observers start."""
        return self.problem.controls.part(slice(self.touched, None))


def observe(model: ObjectModel, episode: AnyEpisode) -> TrackedEpisode:
    """Place the twin in an episode that shows its surface.

    Raises:
        EpisodeError: no hand ever moves the object.
    """
    graph, observed = model.graph, observe_episode(episode)
    spacing = float(np.median(graph.rest_lengths))
    problem = prepare(observed, graph.positions, graph.surface, spacing=spacing)
    touched = observed.touched
    tracks, rest = observed_tracks(problem, graph.surface, observed), observed.at_rest
    centres = rest[farthest_points(rest, PATCHES)]
    times = observed.episode.times
    return TrackedEpisode(
        observed=observed,
        problem=problem,
        tracks=tracks,
        rest=rest,
        rate=FREE if observed.hangs else RATE,
        patches=np.linalg.norm(rest[:, None] - centres[None], axis=2).argmin(axis=1),
        blocks=block_numbers(times[touched:] - times[touched], BLOCK_S),
    )


def block_numbers(times: np.ndarray, block_s: float) -> np.ndarray:
    """[T] the block of time of each frame [T], seconds; rounding moves no frame to the next."""
    half_a_frame = 0.5 * float(np.median(np.diff(times)))
    return np.floor((times + half_a_frame) / block_s).astype(int)
