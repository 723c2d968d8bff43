"""FitProblem: an episode made ready to compare rollouts with."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.evaluation import bind_tracks, split_frames
from egophys_core.observation.contact import Hand
from egophys_core.observation.driving import controls_of
from egophys_core.observation.observed import AnyEpisode, observe_episode
from egophys_core.observation.registration import place, placed
from egophys_core.observation.unmoved import why_unmoved
from egophys_core.simulation import Controls

LEAD_FRAMES = 3
"""Frames simulated before the first contact: at rest nothing can be learnt, and a few let the object settle."""

ANOTHER_OBJECT, LEAST_APART = 0.65, 0.012
"""Median distance of the points at rest to the placed twin, over its spacing and in metres, from which they show
something else: 0.25 (6 mm) for the same object, 0.4 (9 mm) for another toy of its size and shape, 0.84 (17 mm) and more
for other objects."""

FEWEST_CONTACT_FRAMES = 5
"""Train frames with contact below which there is nothing to fit."""


@dataclass(frozen=True, kw_only=True)
class FitProblem:
    """One episode, the object placed in it, and which frames count."""

    episode: Episode
    hands: tuple[Hand, ...]
    start: np.ndarray
    """[N, 3] float32, node positions at rest in this episode, metres, world."""
    bound: np.ndarray
    """[P] surface node of each track, -1 for none."""
    controls: Controls
    """Over all frames of the episode."""
    velocities: np.ndarray | None = None
    """[N, 3] float32 m/s, of the nodes when they start; by default they are at rest."""

    @property
    def first_frame(self) -> int:
        """Frame at which fitting rollouts begin, with the object at rest."""
        return max(0, self._first_contact - LEAD_FRAMES)

    @property
    def _first_contact(self) -> int:
        return min(hand.first for hand in self.hands if hand.touches)

    def require_train_frames(self) -> None:
        """Check that there is something to fit.

        Raises:
            EpisodeError: the first contact comes too late.
        """
        train, needed = self.episode.train_frames, self.first_frame + LEAD_FRAMES + FEWEST_CONTACT_FRAMES
        if train < needed:
            raise EpisodeError(
                f"{self.episode.name}: of its {self.episode.frames} frames the first {train} (70 %) are fitted; with "
                f"the first contact at frame {self._first_contact} it takes {needed}: record more of the handling"
            )

    def train_controls(self) -> Controls:
        """Controls from `first_frame` to the last train frame."""
        return self.controls.part(slice(self.first_frame, self.episode.train_frames))

    def loss_frames(self, stride: int) -> np.ndarray:
        """Frames the loss looks at."""
        return np.arange(self.first_frame + 1, self.episode.train_frames, stride)


def prepare(episode: AnyEpisode, positions: np.ndarray, surface: np.ndarray, *, spacing: float) -> FitProblem:
    """Place an object's nodes in an episode that shows its surface.

    Args:
        episode: as recorded, or observed already.
        positions: [N, 3] metres, the object's nodes at rest.
        surface: [N] bool.
        spacing: metres between nodes.

    Raises:
        EpisodeError: no hand ever moves the object, so there is nothing to fit, or it is another object.
    """
    observed = observe_episode(episode)
    episode, hands = observed.episode, observed.hands
    split_frames(episode)
    if not any(hand.touches for hand in hands):
        raise EpisodeError(f"{episode.name}: {why_unmoved(episode)}")
    resting = observed.at_rest
    pose = place(positions[surface], resting, spacing=spacing)
    start = placed(positions, pose, positions[surface].mean(axis=0))
    _require_same_object(episode.name, start[surface], resting, spacing)
    return FitProblem(
        episode=episode,
        hands=hands,
        start=start,
        bound=bind_tracks(episode.points[0], start[surface]),
        controls=controls_of(episode, hands),
    )


def _require_same_object(name: str, surface: np.ndarray, resting: np.ndarray, spacing: float) -> None:
    """Check that points at rest [P, 3] lie on the placed surface nodes [S, 3], metres.

    Raises:
        EpisodeError: they do not.
    """
    apart = float(np.median(cKDTree(surface).query(resting)[0]))
    if apart > max(ANOTHER_OBJECT * spacing, LEAST_APART):
        raise EpisodeError(
            f"{name}: half of the points at rest lie {1e3 * apart:.0f} mm or more from the nearest node of the twin, "
            "however it is turned on the table; this is another object, or it starts folded or on another side: build "
            "a twin of this episode (egophys build), or record the object as it lay for the twin"
        )
