"""Ranking: which effects of the library could explain what a refitted twin leaves unexplained."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import (
    at_null,
    at_share,
    effect_parameter,
    effect_parameters,
    sizes_of,
    with_effect,
)
from egophys_core.diagnosis.evidence.linear_problem import (
    Columns,
    LinearProblem,
    baseline_columns,
    fit,
    fitted_gain,
    left_out_losses,
    surrogate,
)
from egophys_core.diagnosis.evidence.refit import secant_of
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import LIBRARY, Effect, Surroundings
from egophys_core.twin import ObjectModel

Item = TypeVar("Item")

LEAST_SHIFT = 0.15
"""Share of an episode by which a surrogate is at least shifted."""

SURROGATE_EFFECTS = 8
"""Effects whose regressors are shifted for surrogates."""

BEST_STARTS = 8
"""Starts of an effect, the best by their slopes, from which refits may begin."""


@dataclass(frozen=True, kw_only=True)
class Probe:
    """An effect at one start, and what each of its sizes does to the residuals."""

    effect: Effect
    start: dict[str, float]
    slopes: list[np.ndarray]
    """Per episode [B, Q, 3, C] metres per step of each size."""

    @property
    def sizes(self) -> tuple[str, ...]:
        """Parameters that say how much."""
        return sizes_of(self.effect)

    @property
    def null(self) -> dict[str, float]:
        """The start with all sizes at null."""
        return at_null(self.effect, self.start)

    def columns(self, values: np.ndarray) -> Columns:
        """The slopes, or surrogates of them, as columns [M, C] within the bounds of the sizes."""
        parameters = {parameter.definition.name: parameter for parameter in effect_parameters(self.effect)}
        ends = np.array(
            [
                [
                    parameters[name].position_of(end)
                    for end in (parameters[name].definition.low, parameters[name].definition.high)
                ]
                for name in self.sizes
            ]
        ).reshape(-1, 2)
        at = np.array([parameters[name].position_of(self.null[name]) for name in self.sizes])
        return Columns(values=values, low=ends[:, 0] - at, high=ends[:, 1] - at)


@dataclass(frozen=True, kw_only=True)
class RankedEffect:
    """The best start of an effect, by the linear problem."""

    probe: Probe
    starts: tuple[dict[str, float], ...]
    """The effect's best starts, the probe's first, at most `BEST_STARTS`, their sizes as slopes point."""
    values: dict[str, float]
    """Parameters at the linear optimum."""
    baseline_steps: np.ndarray
    """[D] steps of the baseline parameters to that optimum."""
    fitted_gain: float
    held_out_gain: float

    @property
    def name(self) -> str:
        """The effect's."""
        return self.probe.effect.name


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """All effects, best first, and what chance gains."""

    ranked: list[RankedEffect]
    chance: np.ndarray
    """[S] held-out gain of each surrogate, the largest over effects."""

    def share_of_surrogates(self, gain: float) -> float:
        """Share of surrogates that gain as much."""
        return float((1 + (self.chance >= gain).sum()) / (1 + len(self.chance)))


def surroundings(model: ObjectModel, observations: Sequence[TrackedEpisode]) -> Surroundings:
    """Where and when the episodes happen."""
    points = [each.tracks.positions.reshape(-1, 3) for each in observations]
    return Surroundings(
        rest_positions=model.graph.positions.astype(np.float64),
        low=np.min([np.nanmin(each, axis=0) for each in points], axis=0),
        high=np.max([np.nanmax(each, axis=0) for each in points], axis=0),
        contact_begins=min(float(each.episode.times[each.touched]) for each in observations),
        end=max(float(each.episode.times[-1]) for each in observations),
    )


def probe_effects(
    observations: Sequence[TrackedEpisode],
    model: ObjectModel,
    found: Sequence[np.ndarray],
    *,
    without: Collection[str],
    progress: Callable[[float], None],
    most_starts: int | None = None,
) -> list[Probe]:
    """What every effect of the library does to the residuals `found` at its starts.

    Args:
        without: names of effects that are left out.
        progress: called with the share done.
        most_starts: of an effect, evenly chosen; by default all.
    """
    around = surroundings(model, observations)
    effects = [effect for effect in LIBRARY.values() if effect.name not in without]
    starts = {effect.name: evenly_chosen(effect.starts(around), most_starts) for effect in effects}
    planned = {effect.name: simulated_starts(effect, around, starts[effect.name]) for effect in effects}
    secant = secant_of(observations)
    models = [
        with_effect(model, effect.name, {**at_null(effect, start), name: at_share(effect, start, secant)[name]})
        for effect in effects
        for start in planned[effect.name][0]
        for name in sizes_of(effect)
    ]
    results = residuals(observations, models, progress=progress)
    rows = iter(range(len(models)))
    probes = []
    for effect in effects:
        slopes = []
        simulated, shares = planned[effect.name]
        for start in simulated:
            mine = [(next(rows), secant * _steps(effect, name, start)) for name in sizes_of(effect)]
            slopes.append(
                [
                    _finite(np.stack([(results[index][row] - without) / steps for row, steps in mine], axis=-1))
                    for index, without in enumerate(found)
                ]
            )
        probes.extend(_probes(effect, starts[effect.name], shares, slopes))
    return probes


def _finite(slopes: np.ndarray) -> np.ndarray:
    """Slopes, none where something diverged or is not seen."""
    return np.nan_to_num(slopes, posinf=0.0, neginf=0.0)


def evenly_chosen(items: list[Item], most: int | None) -> list[Item]:
    """At most so many, the first and the last among them; of one alone that is the middle one."""
    if most is None or len(items) <= most:
        return items
    if most == 1:
        return [items[len(items) // 2]]
    return [items[row] for row in np.linspace(0, len(items) - 1, most).round().astype(int)]


def simulated_starts(
    effect: Effect, around: Surroundings, starts: list[dict[str, float]]
) -> tuple[list[dict[str, float]], np.ndarray]:
    """What is simulated for some starts of an effect, and how much of each [S, K] is in each of these.

    Where fewer rollouts tell of all of them, by superposition, it is those.
    """
    if effect.superposition:
        pieces, shares = effect.superposition(around, starts)
        if len(pieces) < len(starts):
            return pieces, shares
    return starts, np.eye(len(starts))


def _probes(
    effect: Effect, starts: Sequence[dict[str, float]], shares: np.ndarray, slopes: Sequence[Sequence[np.ndarray]]
) -> list[Probe]:
    """The probes of all starts, from the slopes of those that were simulated, per start and episode [B, Q, 3, C].

    Args:
        shares: [S, K] how much of each that was simulated is in each start.
    """
    together = [np.stack(each) for each in zip(*slopes, strict=True)]
    return [
        Probe(
            effect=effect,
            start=start,
            slopes=[np.tensordot(share, each, axes=1) for each in together],
        )
        for start, share in zip(starts, shares, strict=True)
    ]


def _steps(effect: Effect, name: str, start: Mapping[str, float]) -> float:
    """How many steps of a parameter lie between null and start."""
    parameter = effect_parameter(effect, name)
    return parameter.position_of(start[name]) - parameter.position_of(at_null(effect, start)[name])


def rank(problem: LinearProblem, probes: Sequence[Probe], *, surrogates: int, seed: int) -> Ranking:
    """The effects by what they gain on stretches of time that were left out, best first."""
    by_effect: dict[str, list[Probe]] = {}
    for probe in probes:
        by_effect.setdefault(probe.effect.name, []).append(probe)
    baseline = baseline_columns(problem)
    baseline_loss = left_out_losses(problem, baseline, problem.fold).sum()

    def held_out(columns: Columns) -> float:
        return float(baseline_loss - left_out_losses(problem, baseline.beside(columns), problem.fold).sum())

    chosen: list[tuple[Probe, float, float]] = []
    starts: dict[str, tuple[dict[str, float], ...]] = {}
    for name, group in by_effect.items():
        columns = [probe.columns(problem.column(probe.slopes)) for probe in group]
        gains = [fitted_gain(problem, each) for each in columns]
        order = np.argsort(gains)[::-1]
        best = order[0]
        starts[name] = tuple(_directed_start(problem, group[row]) for row in order[:BEST_STARTS])
        chosen.append((group[best], gains[best], held_out(columns[best])))
    # Surrogates of the starts that won: enough to say what a regressor of that shape gains by chance.
    generator = np.random.default_rng(seed)
    winners = [probe for probe, _, _ in sorted(chosen, key=lambda each: -each[2])[:SURROGATE_EFFECTS]]
    chance = np.zeros(surrogates)
    for index in range(surrogates):
        shares = generator.uniform(LEAST_SHIFT, 1.0 - LEAST_SHIFT, len(problem.cells))
        patches = generator.permutation(problem.cells[0].shape[1])
        chance[index] = max(
            [0.0, *(held_out(probe.columns(surrogate(problem, probe.slopes, shares, patches))) for probe in winners)]
        )
    ranked = [
        RankedEffect(
            probe=probe,
            starts=starts[probe.effect.name],
            **_optimum(problem, probe),
            fitted_gain=gain,
            held_out_gain=held,
        )
        for probe, gain, held in chosen
    ]
    return Ranking(ranked=sorted(ranked, key=lambda each: -each.held_out_gain), chance=chance)


def _optimum(problem: LinearProblem, probe: Probe) -> dict[str, Any]:
    """The effect's parameters at the linear optimum, within bounds, and steps of the baseline parameters to there."""
    baseline_steps, steps = _optimal_steps(problem, probe)
    return {"values": _moved(probe, steps), "baseline_steps": baseline_steps}


def _directed_start(problem: LinearProblem, probe: Probe) -> dict[str, float]:
    """The start with its sizes as large as they are, together, and in proportion as at the linear optimum."""
    _, steps = _optimal_steps(problem, probe)
    length = np.linalg.norm(steps)
    if length == 0.0:
        return probe.start
    own = np.linalg.norm([_steps(probe.effect, name, probe.start) for name in probe.sizes])
    return _moved(probe, steps * own / length)


def _optimal_steps(problem: LinearProblem, probe: Probe) -> list[np.ndarray]:
    """Steps [D] of the baseline parameters and [C] of the sizes at the linear optimum."""
    columns = baseline_columns(problem).beside(probe.columns(problem.column(probe.slopes)))
    return np.split(fit(problem.residual, columns, problem.scale), [problem.baseline.shape[1]])


def _moved(probe: Probe, steps: np.ndarray) -> dict[str, float]:
    """The effect's parameters so many steps [C] of its sizes from null."""
    values = dict(probe.null)
    for parameter in effect_parameters(probe.effect):
        name = parameter.definition.name
        if name in probe.sizes:
            values[name] = parameter.value_at(parameter.position_of(probe.null[name]) + steps[probe.sizes.index(name)])
    return values
