"""Hands from what they hold: paths of controllers that make a simulated object follow the points that were seen.

In a video the place of a hand in the image is good to some pixels, its depth by its width only to some centimetres. But
what a hand holds moves with it, and what hangs on that is seen. So the paths are solved for: least squares of the
tracked points against a simulation of the object, whose stiffness is a usual one, with the seen paths as prior (weak
along the line of sight) and smooth motion. The simulation is repeated with each knot of a path moved a little, all
of them in one batch (Gauss-Newton by differences); the horizon grows, so that later knots start from a shape that is
right.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.kinds import kind_named
from egophys_core.kinds.rest_shape import rest_shape, surface_model
from egophys_core.observation import FitProblem, observe_episode
from egophys_core.observation.contact import Contact, Hand
from egophys_core.observation.problem import prepare
from egophys_core.simulation import ContactKind, Controls, batch_of_models, rollout
from egophys_core.twin import ObjectModel

KNOT_S = 1 / 6
"""Seconds between the knots of a path, which is straight between them."""

WINDOW = 6
"""Knots that are solved for at once; the horizon grows by half of it."""

DOUBTS_M = (0.06, 0.06, 0.025, 0.015)
"""Metres, of each iteration at a horizon: from here on a miss is rather that of the simulation, which buckles
elsewhere, or of the track. At first the paths themselves are wrong by more."""

STEP_M = 0.004
"""Metres by which a knot is moved for the differences."""

FARTHEST_STEP_M = 0.03
"""Metres: most that an iteration changes between two knots."""

MOST_NODES = 300
"""Surface nodes of the simulated object."""

ACROSS_SIGMA_M = 0.012
"""Metres: of a seen path across the line of sight."""

ALONG_SIGMA_M = 0.05
"""Along it."""

SWERVE_SIGMA_M = 0.012
"""Metres: how far a knot lies off the middle of its neighbours, twice."""

MISS_SIGMA_M = 0.02
"""Metres: of tracked points against a simulation with usual stiffness."""

LET_GO_M = 0.08
"""Metres beside everything that is seen of the object, across the line of sight, from which on a hand does not hold."""

DEPTH_SHARE = 0.2
"""Weight of a miss along the line of sight against one across: a track is as sure as a patch in the image across, but
along it is inferred from the size in which the object appears."""

COUNTED_POINTS = 10
"""The misses of neighbouring points have the same causes: all together count as so many."""

SHARES = (1.0, 0.5, 0.25)
"""Of a step that are tried."""


@dataclass(frozen=True, kw_only=True)
class SolvedHands:
    """Controllers that agree with what they hold."""

    episode: Episode
    """With controllers moved."""
    moved_m: float
    """Metres: mean over hands and frames of contact, from where they were seen."""
    miss_before_m: float
    """Metres: root mean square of the simulation's points against the tracked ones, by the paths as seen."""
    miss_after_m: float
    """By the solved paths."""


def solve_hands(
    episode: Episode,
    camera_centres: np.ndarray,
    contact_frames: Sequence[int] = (),
    *,
    progress: Callable[[float], None] = lambda share: None,
) -> SolvedHands:
    """Solve for the paths of hands.

    Args:
        episode: as seen; each hand's controllers keep their places among each other.
        camera_centres: [T, 3] metres, frame world.
        contact_frames: of each hand, in the order of its first controller: since when it was seen to move the object.
            Where its path is so wrong that no contact is found, a sheet is taken to be held from then on.
        progress: called with the share that is done, 0..1.

    Raises:
        EpisodeError: no hand ever moves the object, or nothing can be simulated from what is seen.
    """
    observed = observe_episode(episode)
    shape = rest_shape(observed.at_rest, name=episode.name, ground=episode.ground_height, max_nodes=MOST_NODES)
    start = np.array([number.start_u for number in surface_model(kind_named(shape.kind)).searched])
    usual = surface_model(kind_named(shape.kind)).candidate(shape, start, ground_height=episode.ground_height)
    # A hand that holds turns what it holds: a wide grasp does, a narrow one is a hinge.
    model = max(kind_named(shape.kind).variants(usual), key=lambda each: each.parameters.controller_radius)
    hands = observed.hands
    if shape.kind == "sheet" and len(contact_frames) == len(hands):
        hands = tuple(_held_since(hand, frame) for hand, frame in zip(hands, contact_frames, strict=True))
    hands = tuple(_holding_on(hand, observed.episode, camera_centres) for hand in hands)
    observed = replace(observed, hands=hands)
    problem = prepare(observed, shape.positions, shape.surface, spacing=shape.spacing)
    solver = _Solver(problem, model, camera_centres)
    path = solver.solve(progress)
    return solver.solved(path)


def _held_since(hand: Hand, frame: int) -> Hand:
    """The hand, with a hold from a frame on if it has no contact."""
    if hand.touches:
        return hand
    return replace(hand, contacts=(Contact(first=frame, last=frame, kind=ContactKind.HOLD),))


def _holding_on(hand: Hand, episode: Episode, camera_centres: np.ndarray) -> Hand:
    """The hand, which holds what it took until it is seen beside the object: its depth is not sure enough to tell.

    `find_hands` takes a hand whose depth wanders by centimetres for one that lets go and takes hold again.
    """
    first = next((each for each in hand.contacts if each.kind == ContactKind.HOLD), None)
    if first is None:
        return hand
    place = episode.controllers[:, hand.controllers].mean(axis=1)
    sight = place - camera_centres
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    to_points = episode.points - camera_centres[:, None]
    beside = np.linalg.norm(np.cross(to_points, sight[:, None]), axis=2)
    nearest = np.nanmin(np.where(np.isfinite(beside), beside, np.inf), axis=1)
    seen = np.isfinite(nearest) & (np.arange(episode.frames) > first.first)
    gone = np.flatnonzero(seen & (nearest > LET_GO_M))
    last = int(gone[0]) - 1 if len(gone) else episode.frames - 1
    before = tuple(each for each in hand.contacts if each.last < first.first)
    return replace(hand, contacts=(*before, replace(first, last=max(last, first.last))))


class _Solver:
    """Paths [K, H, 3] of H hands at K knots, metres."""

    def __init__(self, problem: FitProblem, model: ObjectModel, camera_centres: np.ndarray) -> None:
        self._problem, self._model = problem, model
        episode = problem.episode
        self._times = episode.times
        self._first = problem.first_frame
        self._tracks = problem.bound >= 0
        self._nodes = problem.bound[self._tracks]
        self._points = episode.points[:, self._tracks].astype(float)
        self._hand_of = np.zeros(episode.controllers.shape[1], int)
        for number, hand in enumerate(problem.hands):
            self._hand_of[hand.controllers] = number
        seen = np.stack([episode.controllers[:, hand.controllers].mean(axis=1) for hand in problem.hands], axis=1)
        self._around = episode.controllers - seen[:, self._hand_of]
        self._knots = np.arange(0.0, self._times[-1] + KNOT_S, KNOT_S)
        self._seen = _between(self._times, seen, self._knots)
        sight = self._seen - _between(self._times, camera_centres[:, None], self._knots)
        sight /= np.linalg.norm(sight, axis=2, keepdims=True)
        along = sight[..., :, None] * sight[..., None, :]
        to_points = self._points - camera_centres[:, None]
        self._sights = to_points / np.linalg.norm(to_points, axis=2, keepdims=True)
        self._information = along / ALONG_SIGMA_M**2 + (np.eye(3) - along) / ACROSS_SIGMA_M**2

    def solve(self, progress: Callable[[float], None]) -> np.ndarray:
        path, last = self._seen.copy(), len(self._knots) - 1
        first = int(np.searchsorted(self._knots, self._times[self._first]))
        horizon = first + WINDOW
        while True:
            horizon = min(horizon, last)
            free = np.arange(max(first, horizon - WINDOW - 2), horizon + 1)
            for doubt in DOUBTS_M:
                path = self._improved(path, free, doubt)
            progress(horizon / last)
            if horizon == last:
                return path
            horizon += WINDOW // 2

    def solved(self, path: np.ndarray) -> SolvedHands:
        episode = self._problem.episode
        everything = np.arange(len(self._knots))
        misses = self._misses([self._seen, path], everything)
        rms = [float(np.sqrt(np.nanmean((each**2).sum(axis=-1)))) for each in misses]
        moved = np.linalg.norm(_between(self._knots, path - self._seen, self._times)[self._first :], axis=2)
        return SolvedHands(
            episode=replace(episode, controllers=self._controllers(path).astype(np.float32)),
            moved_m=float(moved.mean()),
            miss_before_m=rms[0],
            miss_after_m=rms[1],
        )

    def _improved(self, path: np.ndarray, free: np.ndarray, doubt: float) -> np.ndarray:
        """One step of Gauss-Newton over the changes from knot to knot at `free`."""
        hands = path.shape[1]
        moved = []
        for knot in free:
            for unit in np.eye(hands * 3).reshape(-1, hands, 3):
                other = path.copy()
                other[knot:] += STEP_M * unit
                moved.append(other)
        misses = self._misses([path, *moved], free)
        miss = misses[0]
        slopes = np.nan_to_num(np.moveaxis(misses[1:] - miss, 0, -1) / STEP_M)
        weight = self._weights(miss, doubt)
        miss = np.nan_to_num(miss)
        normal = np.einsum("fp,fpcm,fpcn->mn", weight, slopes, slopes, optimize=True)
        gradient = np.einsum("fp,fpcm,fpc->m", weight, slopes, miss, optimize=True)
        to_path = np.kron(np.tril(np.ones((len(free), len(free)))), np.eye(hands * 3))
        prior, swerve, apart, bends = self._prior(path, free)
        normal += to_path.T @ prior @ to_path + to_path.T @ swerve.T @ swerve @ to_path / SWERVE_SIGMA_M**2
        gradient += to_path.T @ (prior @ apart + swerve.T @ bends / SWERVE_SIGMA_M**2)
        step = -np.linalg.solve(normal + 1e-3 * np.eye(len(normal)), gradient).reshape(len(free), hands, 3)
        step = np.cumsum(np.clip(step, -FARTHEST_STEP_M, FARTHEST_STEP_M), axis=0)
        tried = [path]
        for share in SHARES:
            other = path.copy()
            other[free] += share * step
            other[free[-1] + 1 :] += share * step[-1]
            tried.append(other)
        costs = [
            self._cost(each, free, found, doubt) for each, found in zip(tried, self._misses(tried, free), strict=True)
        ]
        return tried[int(np.argmin(costs))]

    def _prior(self, path: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Information [M, M] and residual [M] of the seen paths; derivative [B, M] and residual [B] of bends."""
        hands = path.shape[1]
        size = len(free) * hands * 3
        information = np.zeros((size, size))
        for index, block in enumerate(self._information[free].reshape(-1, 3, 3)):
            information[3 * index : 3 * index + 3, 3 * index : 3 * index + 3] = block
        apart = (path[free] - self._seen[free]).ravel()
        knots = free[free >= 2]
        bends = (path[knots] - 2 * path[knots - 1] + path[knots - 2]).ravel()
        second = np.zeros((len(knots), len(free)))
        for row, knot in enumerate(knots):
            for back, factor in enumerate((1.0, -2.0, 1.0)):
                if knot - back >= free[0]:
                    second[row, knot - back - free[0]] = factor
        return information, np.kron(second, np.eye(hands * 3)), apart, bends

    def _cost(self, path: np.ndarray, free: np.ndarray, miss: np.ndarray, doubt: float) -> float:
        square = np.nan_to_num((miss**2).sum(axis=-1), nan=0.0)
        data = 0.5 * doubt**2 * np.log1p(square / doubt**2).sum() / MISS_SIGMA_M**2 / self._correlated
        prior, _, apart, bends = self._prior(path, free)
        return float(data + 0.5 * apart @ prior @ apart + 0.5 * (bends**2).sum() / SWERVE_SIGMA_M**2)

    @property
    def _correlated(self) -> float:
        """Tracks that count as one."""
        return max(1.0, float(self._tracks.sum()) / COUNTED_POINTS)

    def _weights(self, miss: np.ndarray, doubt: float) -> np.ndarray:
        """[F, P] 1/m^2; 0 where nothing is seen."""
        square = (miss**2).sum(axis=-1)
        return np.nan_to_num(1 / (1 + square / doubt**2) / MISS_SIGMA_M**2 / self._correlated, nan=0.0)

    def _misses(self, paths: list[np.ndarray], free: np.ndarray) -> np.ndarray:
        """[L, F, P, 3] metres: simulated less tracked points, every other frame of the knots; NaN where not seen.

        Along the line of sight they are shortened to `DEPTH_SHARE`.
        """
        stop = int(np.searchsorted(self._times, self._knots[free[-1]] + 1e-9))
        frames = np.arange(max(self._first + 1, np.searchsorted(self._times, self._knots[free[0]])), stop, 2)
        controls = [
            Controls(
                times=self._times[self._first : stop],
                positions=self._controllers(path)[self._first : stop].astype(np.float32),
                contact=self._problem.controls.contact[self._first : stop],
            )
            for path in paths
        ]
        count = len(paths)
        ground = self._problem.episode.ground_height
        batch = batch_of_models([self._model] * count, controls, starts=[self._problem.start] * count, ground_height=ground)
        positions = rollout(batch).positions[:, frames - self._first]
        miss = positions[:, :, self._nodes].astype(float) - self._points[frames]
        sights = self._sights[frames]
        along = (miss * sights).sum(axis=-1, keepdims=True)
        return np.asarray(miss - (1 - DEPTH_SHARE) * along * sights)

    def _controllers(self, path: np.ndarray) -> np.ndarray:
        """[T, C, 3] metres."""
        return _between(self._knots, path, self._times)[:, self._hand_of] + self._around


def _between(times: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """[M, H, 3]: values [N, H, 3] at increasing times [N], straight between them, at [M]; the ends are kept beyond."""
    flat = values.reshape(len(values), -1)
    found = np.column_stack([np.interp(at, times, column) for column in flat.T])
    return found.reshape(len(at), *values.shape[1:])
