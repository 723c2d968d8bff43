"""What markers show, for tests: the body that they are on, and a model placed at them."""

import numpy as np

from egophys_core.episode import Episode
from egophys_core.kinds.kind import MarkerBody
from egophys_core.kinds.marker_body import marker_body as body_of_markers
from egophys_core.kinds.template import Template
from egophys_core.observation import FitProblem, observe_episode, place_model
from egophys_core.twin import ObjectModel


def marker_body(episode: Episode, template: Template | None) -> MarkerBody:
    """What an object is that an episode shows at a few markers."""
    seen = observe_episode(episode).markers
    assert seen is not None
    return body_of_markers(seen, template)


def place_markers(model: ObjectModel, grasp: np.ndarray, episode: Episode, *, load: float = 0.0) -> FitProblem:
    """A model in an episode, with a load in N at its free end."""
    return place_model(model, grasp, observe_episode(episode, load=load))
