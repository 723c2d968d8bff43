"""A model in an episode of its object: by its few markers, or by registration of what is seen of its surface."""

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.kinds import kind_of
from egophys_core.observation.clamps import STILL, carried_by_clamps
from egophys_core.observation.contact import Contact, Hand
from egophys_core.observation.observed import AnyEpisode, ObservedEpisode, observe_episode
from egophys_core.observation.problem import FitProblem, prepare
from egophys_core.simulation import ContactKind, Controls
from egophys_core.twin import ObjectModel, Twin


def place_twin(twin: Twin, episode: AnyEpisode, *, load: float = 0.0) -> FitProblem:
    """The twin where an episode shows its object. A record of markers begins where their ring-down first turns back.

    Args:
        load: N, the weight of what hangs at the free end of an object with markers.

    Raises:
        EpisodeError: nothing moves the object, or it is another one.
    """
    return place_model(twin.model, twin.grasp, observe_episode(episode, load=load))


def place_model(model: ObjectModel, grasp: np.ndarray, observed: ObservedEpisode) -> FitProblem:
    """A model where an episode shows its object.

    Args:
        grasp: of its twin; where an episode shows markers they tell which node each of them is (`MarkerBody.grasp`).

    Raises:
        EpisodeError: nothing moves the object, or it is another one.
    """
    if observed.is_sparse:
        return _at_markers(model, grasp, observed)
    kind, graph = kind_of(model), model.graph
    if kind.from_surface is None:
        raise EpisodeError(
            f"{observed.episode.name}: it shows {observed.episode.points.shape[1]} points of a surface, and the twin "
            f"is a {kind.name}, which is placed by the markers that it was built from; give a recording of these"
        )
    return prepare(observed, graph.positions, graph.surface, spacing=float(np.median(graph.rest_lengths)))


def _at_markers(model: ObjectModel, grasp: np.ndarray, observed: ObservedEpisode) -> FitProblem:
    """A model held in clamps, which are driven beside what was recorded of them."""
    shown, seen, kind = observed.episode, observed.markers, kind_of(model)
    put = kind.from_markers.place(model, grasp, seen, observed.load) if kind.from_markers and seen else None
    if put is None:
        raise EpisodeError(
            f"{shown.name}: its {shown.points.shape[1]} markers and {shown.controllers.shape[1]} held points are not "
            "those of the twin; is it a twin of these markers (egophys build --template)?"
        )
    count = shown.controllers.shape[1]
    carried = carried_by_clamps(put.hands, put.clamped, still=STILL if put.still is None else put.still)
    driven = np.concatenate([shown.controllers, carried], axis=1)
    contact = np.full(driven.shape[:2], ContactKind.HOLD, np.uint8)
    contact[:, :count] = ContactKind.NONE
    clamp = Hand(
        controllers=np.arange(count, driven.shape[1]),
        contacts=(Contact(first=0, last=shown.frames - 1, kind=ContactKind.HOLD),),
    )
    return FitProblem(
        episode=shown,
        hands=(clamp,),
        start=put.start.astype(np.float32),
        velocities=put.velocities.astype(np.float32),
        bound=put.bound,
        controls=Controls(times=shown.times, positions=driven.astype(np.float32), contact=contact, payload=put.payload),
    )
