"""How an object is seen in an episode: tracks or markers, who holds it and when, and a twin placed in it."""

from egophys_core.observation.contact import Contact, Hand, contact_flags, find_hands
from egophys_core.observation.marker_record import require_carried
from egophys_core.observation.observed import AnyEpisode, ObservedEpisode, observe_episode, observe_episodes
from egophys_core.observation.placing import place_model, place_twin
from egophys_core.observation.present import (
    BoundPoints,
    SeenObject,
    present_nodes,
    require_at_rest,
    with_new_points,
)
from egophys_core.observation.problem import FitProblem, prepare

__all__ = [
    "AnyEpisode",
    "BoundPoints",
    "Contact",
    "FitProblem",
    "Hand",
    "ObservedEpisode",
    "SeenObject",
    "contact_flags",
    "find_hands",
    "observe_episode",
    "observe_episodes",
    "place_model",
    "place_twin",
    "prepare",
    "present_nodes",
    "require_at_rest",
    "require_carried",
    "with_new_points",
]
