"""The baseline Spring-Gaus as the paper adapted it: its physical model, fitted to the observations of all methods.

Zhong, Yu, Wu, Li, "Reconstruction and Simulation of Elastic Objects with Spring-Mass 3D Gaussians", ECCV 2024: a
stiffness per volume anchor and a soft vector (`anchor_springs`), one friction and one damping for the whole body. What
was taken over and what could not be: docs/notes/spring_gaus.md.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.prior.anchor_springs import AnchorSprings, anchor_springs
from benchmarks.prior.anchors import AnchoredItem
from egophys_core.errors import SimulationError
from egophys_core.evaluation import Scores, score
from egophys_core.identification.adam import Adam
from egophys_core.identification.dense import SMALLEST
from egophys_core.identification.loss import errors_and_gradient
from egophys_core.observation import FitProblem
from egophys_core.simulation import Controls, RolloutBatch, batch_of_models, rollout, spring_order
from egophys_core.simulation.gradients import differentiate
from egophys_core.twin import ObjectModel

ITS_PASSES = 300
"""Over the train frames, on its synthetic objects, of which ours are; 200 on its real ones."""

PASSES = 100
"""Over the train frames here, of steps three times as long: a pass takes 1 to 2 seconds of a core."""

RATE = 1e-3
"""Its step of Adam: of logarithms to base 10 of stiffness, of the soft vector and of what friction is made of. Its
damping of 0.1 moves by 1e-4, about this share of itself."""

UPDATES = 19
"""Steps that it takes in a pass: one a frame, of 20, after each of which it goes on with another stiffness. Our frames
are rolled out together, and one step goes as far as those."""

WINDOWS = 8
"""Of truncated back-propagation, as in dense refinement. It passes derivatives back over one frame alone: so
the train loss of a towel rose by 6 % in 16 passes, with these it fell by 16 %."""

STEP = RATE * UPDATES * ITS_PASSES / PASSES
"""About the largest change of a coordinate in a pass."""

STRIDE = 2
"""Every how many-th train frame the loss looks at, as in the other fits."""

FARTHEST = 1.0
"""Decades that a stiffness may move from its start, so that the substeps at most triple; it has no such bound."""

GLOBALS = ("softness", "friction", "damping", "controller_stiffness")
"""Coordinates after those of the anchors."""


@dataclass(frozen=True, kw_only=True)
class AnchorBody:
    """An object as Spring-Gaus has it."""

    model: ObjectModel
    """Its anchors as nodes, its springs and its parameters; the stiffness of its springs is below."""
    springs: AnchorSprings
    anchors: np.ndarray
    """[N] K, newtons."""
    softness: float
    """h of the soft vector."""
    dashpot: float
    """z, N s."""

    def batch(self, problem: FitProblem, controls: Controls) -> RolloutBatch:
        """One rollout of it, driven by the hands of an episode."""
        batch = batch_of_models(
            [self.model],
            [controls],
            starts=[problem.start],
            velocities=[problem.velocities],
            ground_height=problem.episode.ground_height,
        )
        order = np.argsort(spring_order(self.model))
        stiffness, damping = self.springs.stiffness(self.anchors, self.softness), self.springs.damping(self.dashpot)
        return replace(
            batch,
            stiffness=stiffness[order][None].astype(np.float32),
            damping=damping[order][None].astype(np.float32),
        )


@dataclass(frozen=True, kw_only=True)
class SpringGausFit:
    """What came of the fit of one sequence."""

    positions: np.ndarray
    """[T, N, 3] metres, all frames of the episode; NaN if it diverged."""
    surface: np.ndarray
    """[N] bool, which of these can be seen."""
    scores: Scores | None
    """None if it diverged."""
    seconds: float
    """Of one core, without the coarse fit's."""
    losses: np.ndarray
    """[passes] metres, on the train frames before each step; infinite where it diverged."""
    body: AnchorBody
    """The one of the least loss."""

    def errors(self) -> dict[str, float | None]:
        """Chamfer distances and track errors of train and test frames, metres; None where they are not finite."""
        names = {"train_cd_m": "train_chamfer_m", "test_cd_m": "test_chamfer_m"}
        names |= {"train_te_m": "train_track_m", "test_te_m": "test_track_m"}
        values = {} if self.scores is None else self.scores.as_dict()
        found = {name: values.get(key, np.inf) for name, key in names.items()}
        return {name: value if np.isfinite(value) else None for name, value in found.items()}


def fit_spring_gaus(
    anchored: AnchoredItem,
    *,
    passes: int = PASSES,
    neighbours: int | None = None,
    progress: Callable[[int, float], None] = lambda done, loss: None,
) -> SpringGausFit:
    """Fit the model to the train frames of a sequence, from a body that is alike throughout.

    The pass of least loss is kept. Its authors keep the last one, of much shorter steps.

    Args:
        passes: over the train frames.
        neighbours: that an anchor asks for; an eighth of all by default.
        progress: called after each pass with their number and its loss, metres; may raise to stop.
    """
    began = time.process_time()
    start = body_like(anchored.model, neighbours)
    refinement = SpringGausRefinement(anchored.problem, start)
    for done in range(passes):
        progress(done + 1, refinement.step())
    positions, surface = predict_body(refinement.best, anchored.problem), start.model.graph.surface
    return SpringGausFit(
        positions=positions,
        surface=surface,
        scores=score(positions, surface, anchored.episode) if np.isfinite(positions).all() else None,
        seconds=time.process_time() - began,
        losses=np.array(refinement.losses),
        body=refinement.best,
    )


def body_like(model: ObjectModel, neighbours: int | None = None) -> AnchorBody:
    """A body that is alike throughout and stores, and loses, as much as a coarse fit when it is stretched evenly.

    Its authors start from a stiffness that they set by hand for each object; here the coarse fit, which all methods
    begin with, stands for that. Contacts, hands and mass are those of the coarse fit. What Spring-Gaus does not have
    is off: bending springs, strain limit, softer compression, drag, bouncing and the projection of forces at the table.
    """
    graph = model.graph
    springs = anchor_springs(graph.positions.astype(np.float64), neighbours)
    squared = springs.rest_lengths**2
    # Evenly stretched by e, a spring stores k (e l0)^2 / 2.
    stored, lost = (float((each * graph.rest_lengths**2).sum()) for each in (model.stiffness, model.spring_damping))
    even = np.ones(len(graph.positions))
    parameters = replace(
        model.parameters,
        friction=max(model.parameters.friction, SMALLEST),
        strain_limit=1e6,
        compression_ratio=1.0,
        drag=0.0,
        restitution=0.0,
        ground_projection=0.0,
    )
    return AnchorBody(
        model=replace(
            model,
            graph=springs.graph(graph.positions, graph.surface),
            stiffness=np.full(len(squared), model.parameters.stiffness, np.float32),
            parameters=parameters,
        ),
        springs=springs,
        anchors=stored / float((springs.stiffness(even, 0.0) * squared).sum()) * even,
        softness=0.0,
        dashpot=lost / float((springs.damping(1.0) * squared).sum()),
    )


class SpringGausRefinement:
    """Adam on the anchors' stiffness and what the body has one of (`GLOBALS`); `best` has the least loss so far."""

    def __init__(self, problem: FitProblem, start: AnchorBody) -> None:
        """Start at a body."""
        self.problem, self.start = problem, start
        self.coordinates = np.zeros(len(start.anchors) + len(GLOBALS))
        self.best_coordinates = self.coordinates
        self.adam = Adam(rate=STEP, size=len(self.coordinates))
        self.losses: list[float] = []

    def step(self) -> float:
        """Roll out, go a step down the gradient, and return the loss before it, metres.

        From a body that diverges, which has no gradient, it goes on from the best one with what momentum is left.
        """
        loss, gradient = self.derivative(self.coordinates)
        if loss < min(self.losses, default=np.inf):
            self.best_coordinates = self.coordinates
        self.losses.append(loss)
        begun = self.coordinates if np.isfinite(loss) else self.best_coordinates
        self.coordinates = np.clip(begun - self.adam.step(gradient), -self._farthest, self._farthest)
        return loss

    @property
    def best(self) -> AnchorBody:
        """The body of the least loss so far; the start if all diverged."""
        return body_at(self.start, self.best_coordinates)

    @property
    def _farthest(self) -> np.ndarray:
        """[N + 4]: the soft vector, which makes no spring stiffer, has no bound."""
        return np.where(np.arange(len(self.coordinates)) == len(self.start.anchors), np.inf, FARTHEST)

    def derivative(self, coordinates: np.ndarray, windows: int = WINDOWS) -> tuple[float, np.ndarray]:
        """The loss at some coordinates, metres, and its derivative [N + 4]; infinite and 0 if the body diverges.

        Args:
            windows: of truncated back-propagation.
        """
        body, problem = body_at(self.start, coordinates), self.problem
        frames, surface = problem.loss_frames(STRIDE), body.model.graph.surface
        controls = problem.train_controls()

        def loss(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            errors, seeds = errors_and_gradient(positions[0], surface, problem, frames, fitted=len(frames))
            return np.array([np.nanmean(errors)]), seeds[None]

        try:
            batch = body.batch(problem, controls)
            _, losses, gradient = differentiate(batch, loss, windows=windows)
        except SimulationError:
            return np.inf, np.zeros_like(coordinates)
        order = spring_order(body.model)
        by_anchors, by_softness = body.springs.to_anchors(gradient.stiffness[0, order], body.anchors, body.softness)
        by_dashpot = float((gradient.damping[0, order] * body.springs.damping(1.0)).sum())
        parameters = body.model.parameters
        by_globals = [
            by_softness,
            gradient.parameters["friction"][0] * parameters.friction * np.log(10.0),
            by_dashpot * body.dashpot * np.log(10.0),
            gradient.controller_stiffness[0] * parameters.controller_stiffness * np.log(10.0),
        ]
        return float(losses[0]), np.concatenate([by_anchors * body.anchors * np.log(10.0), by_globals])


def body_at(start: AnchorBody, coordinates: np.ndarray) -> AnchorBody:
    """The body at coordinates [N + 4] from a start: decades of the anchors' stiffness, h, and decades of the others."""
    count = len(start.anchors)
    softness, friction, damping, controller = coordinates[count:]
    parameters = start.model.parameters
    moved = replace(
        parameters,
        friction=parameters.friction * float(10.0**friction),
        controller_stiffness=parameters.controller_stiffness * float(10.0**controller),
    )
    return replace(
        start,
        model=replace(start.model, parameters=moved),
        anchors=start.anchors * 10.0 ** coordinates[:count],
        softness=start.softness + float(softness),
        dashpot=start.dashpot * float(10.0**damping),
    )


def predict_body(body: AnchorBody, problem: FitProblem) -> np.ndarray:
    """[T, N, 3] metres, as `identification.building.predict`; NaN if the rollout diverges."""
    first, frames = problem.first_frame, len(problem.controls.times)
    nothing = np.full((frames, *problem.start.shape), np.nan)
    try:
        result = rollout(body.batch(problem, problem.controls.part(slice(first, None))))
    except SimulationError:
        return nothing
    if result.failures[0] is not None:
        return nothing
    return np.concatenate([np.repeat(problem.start[None], first, axis=0), result.positions[0]])
