"""A synthetic cantilever with three markers near its tip, whose ring-downs our simulator makes."""

from dataclasses import replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.kinds.kind import MarkerBody
from egophys_core.kinds.lattice import lattice_model
from egophys_core.kinds.template import parse_template
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import ObjectModel, Provenance, Twin
from tests.kinds.seen_markers import marker_body, place_markers

HELD = np.array([[-0.005, -0.01, 0.5], [-0.005, 0.01, 0.5], [0.015, 0.0, 0.5]]) - [0.0017, 0.0, 0.0]
TRACKS = np.array([[0.095, -0.008, 0.504], [0.095, 0.008, 0.504], [0.092, 0.0, 0.492]])
TEMPLATE = "box:0.1x0.015x0.015"
DENSITY, RATE, DRAG = 1000.0, 8e6, 3.0
FRAMES = 120


def still_episode(held: np.ndarray = HELD, tracks: np.ndarray = TRACKS, *, frames: int = FRAMES) -> Episode:
    """The markers where they are before anything moves."""
    return Episode(
        name="cantilever",
        times=0.01 * np.arange(frames),
        points=np.repeat(tracks[None], frames, axis=0).astype(np.float32),
        confidence=np.ones((frames, len(tracks)), np.float32),
        point_ids=np.arange(len(tracks), dtype=np.uint32),
        controllers=np.repeat(held[None], frames, axis=0).astype(np.float32),
        controller_ids=np.arange(len(held), dtype=np.uint32),
    )


def body_and_model() -> tuple[MarkerBody, ObjectModel]:
    """The cantilever, straight, and its true numbers."""
    body = marker_body(still_episode(), parse_template(TEMPLATE))
    stiffness = RATE * DENSITY * body.spacing**3
    return body, lattice_model(body, density=DENSITY, stiffness=stiffness, damping=1e-9, drag=DRAG)


def ring_down_episode(body: MarkerBody, model: ObjectModel, *, load: float = 0.0, frames: int = FRAMES) -> Episode:
    """The cantilever released under gravity, with so many newtons at its end."""
    episode = still_episode(frames=frames)
    problem = place_markers(model, body.grasp, episode, load=load)
    result = rollout(batch_of_models([model], [problem.controls], starts=[problem.start], ground_height=-10.0))
    result.raise_on_failure()
    return replace(episode, points=result.positions[0][:, -len(TRACKS) :])


def twin_of(body: MarkerBody, model: ObjectModel) -> Twin:
    return Twin(
        model=model,
        grasp=body.grasp,
        ground_height=-10.0,
        provenance=Provenance(episodes=(), settings={}, seed=0, code_version="", scores={}),
    )
