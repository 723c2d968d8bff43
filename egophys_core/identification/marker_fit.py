"""From episodes of an object with a few markers to a twin: one stiffness, one damping, one drag.

Free rollouts tell them: markers are too few and too well measured for anything to be smoothed away. A swing that has
the wrong period looks as wrong as any other, so the sag under gravity tells the stiffness first, with the swing
damped away; then its period does, then all numbers are refined together. How far a rod sags tells its thickness.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core import __version__
from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError, OptionsError, TwinError
from egophys_core.evaluation import score
from egophys_core.identification.build import episode_digest, predict
from egophys_core.identification.checks import require_fittable
from egophys_core.identification.markers import MarkerBody, marker_bodies, place_markers, turned
from egophys_core.identification.problem import FitProblem
from egophys_core.identification.rods import is_rod, modulus_of_rod
from egophys_core.identification.template import Template, stiffness_of_modulus
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import ObjectKind, ObjectModel, PhysicalParameters, Provenance, Twin, per_kind

DENSITY = 1000.0
"""kg/m^3, of most that is soft."""

MODULI = np.geomspace(3e3, 1e7, 32)
"""Young's moduli in Pa, from a sponge to rubber, at which the sag is looked at."""

SWING_GONE = 20.0
"""1/s, a drag that leaves a sag and no swing."""

SOME_DRAG = 1.0
"""1/s, first guess."""

GRIP = 5.0
"""Stiffness with which a clamped node is held over that of a spring; more asks for more substeps."""

GRIP_RADIUS = 0.3
"""Of a clamped point, in cells: it holds its own node."""

NEAR = np.geomspace(0.75, 1.33, 32)
"""Times the stiffness of the sag, within which that of the swing is looked for."""

DAMPING_S = 1e-5
"""Seconds, first guess of dashpot over spring. Dashpots act on all relative motion, so a slender body's turning too."""

STEPS = (0.05, 0.7, 1.0, 0.005, 0.005)
"""First steps of the refinement in the logarithms of stiffness and damping, in drag (1/s), pitch and yaw (rad)."""

NUMBERS_OF_A_ROD = 3
"""How a rod points is told by the curve that it is seen on."""

FINALISTS = 3
"""Bodies that are refined: a rod's thickness and how it is damped are told together."""

REFINEMENTS = 30
"""Rounds; one without a better neighbour halves the steps."""

LEAP = 2.0
"""Times the last move, also tried: a valley is followed faster."""

LEAST_GAIN = 1e-3
"""Share of the error that a move must save, or steps are halved."""

LEAST_STEP = 0.02
"""Share of the first steps below which the refinement ends."""

Progress = Callable[[str, float, float], None]


def build_marker_twin(
    episodes: Sequence[Episode],
    template: Template | None,
    *,
    density: float = DENSITY,
    loads: Mapping[str, float] | None = None,
    progress: Progress = lambda stage, share, loss: None,
) -> Twin:
    """Fit a twin to the train frames of episodes in which an object is seen at a few markers.

    Args:
        template: what the object looks like; by default a bar between held points and markers.
        density: kg/m^3; gives a load in newtons its meaning.
        loads: per name of an episode the weight in N of what hangs at the free end.

    Raises:
        EpisodeError: no held points, or episodes with different markers.
        OptionsError: a load for no episode, or a density that is not positive.
        TwinError: all rollouts diverged.
    """
    if not episodes:
        raise EpisodeError("no episode given; a twin is built from at least one")
    if not density > 0:
        raise OptionsError(f"density must be positive, got {density} kg/m^3")
    hung = dict(loads or {})
    require_loads_of(hung, episodes)
    for episode in episodes:
        require_fittable(episode)
    progress("prepare", 0.0, float("nan"))
    bodies = marker_bodies(episodes[0], template)
    fit = best_fit([MarkerSearch(body, episodes, hung, density) for body in bodies], progress)
    model, problem = fit.model, fit.problems[0]
    scores = score(predict(model, problem), model.graph.surface, problem.episode)
    return Twin(
        model=model,
        grasp=fit.grasp,
        ground_height=problem.episode.ground_height,
        provenance=Provenance(
            episodes=tuple({"name": each.name, "sha256": episode_digest(each)} for each in episodes),
            settings={
                "density": density,
                "loads": hung,
                "assumed": list(fit.notes),
                "pitch_rad": fit.pitch,
                "yaw_rad": fit.yaw,
                "rmse_m": fit.error,
            },
            seed=0,
            code_version=__version__,
            scores=scores.as_dict(),
        ),
    )


def require_loads_of(loads: Mapping[str, float], episodes: Sequence[Episode]) -> None:
    """Check that every load belongs to an episode and has a size.

    Raises:
        OptionsError: it does not.
    """
    names = [episode.name for episode in episodes]
    for name, newtons in loads.items():
        if name not in names:
            raise OptionsError(f"a load is given for {name}, which is not among the episodes {', '.join(names)}")
        if not 0.0 <= newtons < np.inf:
            raise OptionsError(f"the load of {name} must be newtons, not negative, got {newtons}")


@dataclass(frozen=True, kw_only=True)
class MarkerFit:
    """Where a fit of markers stands."""

    model: ObjectModel
    grasp: np.ndarray
    """[C + P + G, 3] metres, as in `MarkerBody`."""
    problems: tuple[FitProblem, ...]
    """The model in each episode."""
    pitch: float
    """rad, by which the template points higher than its placement says."""
    yaw: float
    """rad, by which it points farther to its left."""
    error: float = np.inf
    """Root mean square distance of the markers in all train frames, metres."""
    notes: tuple[str, ...] = ()
    """What was assumed, in words."""


def best_fit(searches: Sequence["MarkerSearch"], progress: Progress = lambda stage, share, loss: None) -> MarkerFit:
    """The best of several bodies: those that hang as they are seen are refined.

    Raises:
        TwinError: all rollouts diverged.
    """
    sags = [search.sag() for search in searches]
    order = np.argsort([error for _, error in sags])[:FINALISTS]
    progress("sag", 0.2, sags[order[0]][1])
    fits = []
    for rank, index in enumerate(order):

        def its_progress(stage: str, share: float, error: float, rank: int = rank) -> None:
            progress(stage, 0.2 + 0.8 * (rank + share) / len(order), error)

        fits.append(searches[index].run(sags[index][0], its_progress))
    return min(fits, key=lambda fit: fit.error)


class MarkerSearch:
    """The object in its episodes, with numbers to be found."""

    def __init__(self, body: MarkerBody, episodes: Sequence[Episode], loads: Mapping[str, float], density: float):
        self.body, self.episodes, self.loads, self.density = body, episodes, loads, density
        self.node_mass = density * body.spacing**3
        self.known = episodes[0].controllers.shape[1] + episodes[0].points.shape[1]
        self.rod = is_rod(body.grasp[: self.known].astype(np.float64))

    def at(self, numbers: np.ndarray) -> MarkerFit:
        """Of numbers [5]: log stiffness over node mass, log damping over stiffness, drag (1/s), pitch and yaw (rad)."""
        rate, time, drag, pitch, yaw = (float(number) for number in numbers)
        body = turned(self.body, self.known, pitch=pitch, yaw=yaw)
        stiffness = float(np.exp(rate)) * self.node_mass
        model = marker_model(
            body,
            density=self.density,
            stiffness=stiffness,
            damping=float(np.exp(time)) * stiffness,
            drag=max(drag, 0.0),
        )
        problems = [
            place_markers(model, body.grasp, each, load=self.loads.get(each.name, 0.0)) for each in self.episodes
        ]
        return MarkerFit(
            model=model, grasp=body.grasp, problems=tuple(problems), pitch=pitch, yaw=yaw, notes=body.notes
        )

    def best(self, candidates: np.ndarray) -> tuple[np.ndarray, float]:
        """The best of numbers [K, 5], and its error in metres.

        Raises:
            TwinError: all rollouts diverged.
        """
        fits = [self.at(numbers) for numbers in candidates]
        errors = marker_errors(fits)
        row = int(np.argmin(errors))
        if not np.isfinite(errors[row]):
            raise TwinError(f"none of {len(fits)} stiffnesses could be simulated; check the template's size")
        return candidates[row], float(errors[row])

    def sag(self) -> tuple[np.ndarray, float]:
        """Numbers [5] with which it hangs as it is seen, and the error in metres.

        A rod's thickness tells how far it bends, and its modulus that it hardly stretches. If hands move it, it swings
        whatever its drag is.
        """
        if self.rod:
            modulus = np.array([modulus_of_rod(self.body.length, self.density)])
            rates = np.log(stiffness_of_modulus(modulus, self.body.spacing) / self.node_mass)
            return self.best(np.concatenate([_numbers(rates, DAMPING_S, drag) for drag in (SOME_DRAG, SWING_GONE)]))
        rates = np.log(stiffness_of_modulus(MODULI, self.body.spacing) / self.node_mass)
        return self.best(_numbers(rates, DAMPING_S, SWING_GONE))

    def run(self, here: np.ndarray, progress: Progress) -> MarkerFit:
        """The swing, then all together, from the numbers [5] of the sag."""
        here, error = self.best(_numbers(here[0] + np.log(NEAR), DAMPING_S, SOME_DRAG))
        progress("swing", 0.2, error)
        free = NUMBERS_OF_A_ROD if self.rod else len(STEPS)
        shrunk, move = 1.0, np.zeros(len(STEPS))
        for round_ in range(REFINEMENTS):
            sides = np.diag(shrunk * np.array(STEPS))[:free]
            found, its_error = self.best(here + np.concatenate([sides, -sides, [LEAP * move, move]])[:-1])
            if its_error < (1.0 - LEAST_GAIN) * error:
                move, here, error = found - here, found, its_error
            else:
                shrunk, move = shrunk / 2, np.zeros(len(STEPS))
            progress("refine", 0.2 + 0.8 * (round_ + 1) / REFINEMENTS, error)
            if shrunk < LEAST_STEP:
                break
        return replace(self.at(here), error=error)


def marker_model(body: MarkerBody, *, density: float, stiffness: float, damping: float, drag: float) -> ObjectModel:
    """The model of a lattice with one stiffness, N/m, one dashpot, N s/m, and a drag, 1/s; clamped as stiffly."""
    graph = body.graph
    return ObjectModel(
        kind=ObjectKind.SOLID,
        graph=graph,
        parameters=PhysicalParameters(
            total_mass=density * body.spacing**3 * len(graph.positions),
            stiffness=stiffness,
            damping=damping,
            drag=drag,
            strain_limit=1e6,
            controller_stiffness=GRIP * stiffness,
            controller_radius=GRIP_RADIUS * body.spacing,
            controller_neighbours=1,
        ),
        stiffness=per_kind(graph, stiffness, 1.0),
    )


def marker_errors(fits: Sequence[MarkerFit]) -> np.ndarray:
    """[K] metres: root mean square distance of the markers in the train frames of all episodes; inf if diverged."""
    squares, count = np.zeros(len(fits)), 0
    for problems in zip(*(fit.problems for fit in fits), strict=True):
        controls = [problem.train_controls() for problem in problems]
        result = rollout(
            batch_of_models(
                [fit.model for fit in fits],
                controls,
                starts=[problem.start for problem in problems],
                ground_height=problems[0].episode.ground_height,
            )
        )
        observed = problems[0].episode.points[: len(controls[0].times)]
        seen = np.isfinite(observed).all(axis=2)
        offsets = result.positions[:, :, problems[0].bound] - observed[None]
        distances = np.where(seen[None], np.einsum("kfpi,kfpi->kfp", offsets, offsets), 0.0)
        squares += np.where(np.isfinite(distances).all(axis=(1, 2)), distances.sum(axis=(1, 2)), np.inf)
        count += int(seen.sum())
    return np.asarray(np.sqrt(squares / max(count, 1)))


def _numbers(rates: np.ndarray, time: float, drag: float) -> np.ndarray:
    """[K, 5] numbers of several stiffness rates."""
    return np.stack([rates, *(np.full(len(rates), each) for each in (np.log(time), drag, 0.0, 0.0))], axis=1)
