"""Self-collision written again: float64, NumPy, one pair after the other, with nodes really split into parts.

Slow and plain on purpose; shares no code with `egophys_core.simulation`.
"""

from collections.abc import Iterable

import numpy as np

GRAVITY = 9.81
Pair = tuple[int, int, float]
"""Node, node, collision distance m."""


def candidate_pairs(
    positions: np.ndarray, velocities: np.ndarray, rest_positions: np.ndarray, *, distance: float, horizon: float
) -> set[tuple[int, int]]:
    """Pairs i < j that on straight paths come nearer than distance + tolerance within the horizon.

    The tolerance is half their relative path and a fall from rest. Pairs that a half circle of that diameter joins on
    the object are left out.

    Args:
        positions: [N, 3] metres.
        velocities: [N, 3] m/s.
        rest_positions: [N, 3] metres.
        distance: metres; 0 for no self-collision.
        horizon: seconds.
    """
    return {
        pair
        for pair, spare in spare_distances(positions, velocities, rest_positions, distance, horizon).items()
        if spare > 0
    }


def spare_distances(
    positions: np.ndarray, velocities: np.ndarray, rest_positions: np.ndarray, distance: float, horizon: float
) -> dict[tuple[int, int], float]:
    """By how many metres each pair that may collide at all is a candidate; negative where it is none."""
    x, v, rest = (np.asarray(each, np.float64) for each in (positions, velocities, rest_positions))
    spare = {}
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            if distance == 0 or np.linalg.norm(rest[j] - rest[i]) <= np.pi / 2 * distance:
                continue
            d, u = x[j] - x[i], v[j] - v[i]
            speed = np.linalg.norm(u)
            time = float(np.clip(-(d @ u) / speed**2, 0, horizon)) if speed > 0 else 0.0
            tolerance = 0.5 * speed * horizon + 0.5 * GRAVITY * horizon**2
            spare[i, j] = distance + tolerance - float(np.linalg.norm(d + time * u))
    return spare


def recovery_speed(depth: float) -> float:
    """m/s at which nodes that are `depth` metres too near part."""
    return min(100.0 * depth, 0.1)


def colliding_pairs(positions: np.ndarray, velocities: np.ndarray, pairs: Iterable[Pair]) -> list[Pair]:
    """Those of the pairs that are too near and do not part fast enough."""
    found = []
    for i, j, distance in pairs:
        d = positions[j] - positions[i]
        length = float(np.linalg.norm(d))
        if 1e-9 < length < distance:
            parting = (velocities[j] - velocities[i]) @ d / length
            if parting < recovery_speed(distance - length):
                found.append((i, j, distance))
    return found


def two_body_collision(
    masses: tuple[float, float],
    velocities: tuple[np.ndarray, np.ndarray],
    normal: np.ndarray,
    *,
    parting: float,
    friction: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Velocities [3] of two free bodies after a collision along `normal` (from the first to the second).

    They part with speed `parting`; friction takes at most the sliding velocity.
    """
    (m, n), (v, w) = masses, velocities
    common = (m * v + n * w) / (m + n)
    across = common - common @ normal * normal
    v_after = common @ normal - n / (m + n) * parting
    w_after = common @ normal + m / (m + n) * parting
    impulse = m * (v @ normal - v_after)
    sliding_v, sliding_w = v - v @ normal * normal - across, w - w @ normal * normal - across
    momentum = m * np.linalg.norm(sliding_v)
    kept = 1 - min(1.0, friction * impulse / momentum) if momentum > 0 else 0.0
    return v_after * normal + across + kept * sliding_v, w_after * normal + across + kept * sliding_w


def collide(
    positions: np.ndarray,
    velocities: np.ndarray,
    masses: np.ndarray,
    pairs: Iterable[Pair],
    *,
    restitution: float,
    friction: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Contacts [N] and velocities [N, 3] m/s after all collisions at once.

    Every node falls into as many equal parts as it has contacts, each part collides once, and the parts join again.

    Args:
        positions: [N, 3] metres.
        velocities: [N, 3] m/s.
        masses: [N] kg.
        pairs: all that may collide.
        restitution: 0..1.
        friction: Coulomb coefficient.
    """
    x, v, m = (np.asarray(each, np.float64) for each in (positions, velocities, masses))
    hits = colliding_pairs(x, v, pairs)
    contacts = np.bincount([node for i, j, _ in hits for node in (i, j)], minlength=len(x))
    parts: list[list[np.ndarray]] = [[] for _ in x]
    for i, j, distance in hits:
        d = x[j] - x[i]
        length = float(np.linalg.norm(d))
        approach = float((v[i] - v[j]) @ d / length)
        after = two_body_collision(
            (m[i] / contacts[i], m[j] / contacts[j]),
            (v[i], v[j]),
            d / length,
            parting=max(restitution * approach, recovery_speed(distance - length)),
            friction=friction,
        )
        parts[i].append(after[0])
        parts[j].append(after[1])
    return contacts, np.array([np.mean(each, axis=0) if each else v[node] for node, each in enumerate(parts)])
