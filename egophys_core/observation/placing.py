"""A twin in an episode of its object: by its few markers, or by registration of what is seen."""

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.checks import require_fittable
from egophys_core.observation.contact import contact_flags
from egophys_core.observation.markers import is_sparse, place_markers
from egophys_core.observation.problem import FitProblem, prepare
from egophys_core.simulation import ContactKind
from egophys_core.twin import Twin


def place_twin(twin: Twin, episode: Episode, *, load: float = 0.0) -> FitProblem:
    """The twin where an episode shows its object. A record of markers begins where their swing first turns.

    Args:
        load: N, the weight of what hangs at the free end of an object with markers.

    Raises:
        EpisodeError: nothing moves the object, or it is another one.
    """
    require_fittable(episode)
    if is_sparse(episode):
        return place_markers(twin.model, twin.grasp, episode, load=load)
    graph = twin.model.graph
    return prepare(episode, graph.positions, graph.surface, spacing=float(np.median(graph.rest_lengths)))


def observed_contacts(problem: FitProblem) -> np.ndarray:
    """[T, C] `ContactKind` of the controller points of the record; those of a clamp hold all the time."""
    episode = problem.episode
    if is_sparse(episode):
        return np.full(episode.controllers.shape[:2], ContactKind.HOLD, np.uint8)
    return contact_flags(episode, problem.hands)
