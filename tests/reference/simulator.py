"""The simulator written again: float64, NumPy, one spring after the other, straight from the paper's equations.

Slow and plain on purpose; shares no code with `egophys_core.simulation` but the types it is called with.
"""

from collections.abc import Callable, Sequence

import numpy as np

from egophys_core.simulation import ContactKind, Controls, RolloutBatch
from egophys_core.twin import PhysicalParameters
from tests.reference import self_collision

Grip = tuple[int, int, float, ContactKind]
"""Node, controller point, rest length m, what the contact does."""
ExtraForce = Callable[[float, float, np.ndarray, np.ndarray], np.ndarray]
"""From time s, seconds of the substep, positions and velocities [N, 3]: newtons [N, 3] on the nodes."""
ReferenceLaw = Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray]]
"""From strains [E] and seconds of the substep: factors on stiffness and shifts of rest lengths, over these, [E]."""


def spring_force(
    offset: np.ndarray,
    relative_velocity: np.ndarray,
    *,
    stiffness: float,
    damping: float,
    rest: float,
    longest: float,
    compression_ratio: float = 1.0,
) -> np.ndarray:
    """[3] N on the first node: k eta (l - l0) d - gamma (v_i - v_j), eta = min(1, longest / (l - l0)) when stretched.

    Args:
        offset: [3] x_j - x_i, metres.
        relative_velocity: [3] v_i - v_j, m/s.
        stiffness: k, N/m.
        damping: gamma, N s/m.
        rest: l0, metres.
        longest: extension beyond which the spring softens, metres: the paper's strain limit times l0.
        compression_ratio: share of k that a spring has which is shorter than at rest.
    """
    length = float(np.linalg.norm(offset))
    extension = length - rest
    eta = min(1.0, longest / extension) if extension > 0 else compression_ratio
    direction = offset / length if length > 0 else np.zeros(3)
    return stiffness * eta * extension * direction - damping * relative_velocity


FIRMNESS = 10.0
"""Of a press, in stiffnesses and dashpots of a spring."""


def press_force(
    offset: np.ndarray,
    relative_velocity: np.ndarray,
    *,
    stiffness: float,
    damping: float,
    reach: float,
    friction: float,
    stopping: float,
) -> np.ndarray:
    """[3] N on a node at an offset from a point that presses, moving against it.

    Nearer than its reach it is pushed away, never pulled, and braked as Coulomb has it, at most to a stop.

    Args:
        stopping: N s/m, that times its speed stops the node in a substep.
    """
    distance = np.linalg.norm(offset)
    normal = offset / distance
    approach = -relative_velocity @ normal
    push = FIRMNESS * (stiffness * (reach - distance) + damping * approach)
    if distance >= reach or push <= 0:
        return np.zeros(3)
    sliding = relative_velocity + approach * normal
    speed = np.linalg.norm(sliding)
    brake = min(friction * push, stopping * speed)
    return push * normal - (brake * sliding / speed if speed > 0 else 0.0)


def projected(force: np.ndarray, height: float, alpha: PhysicalParameters) -> np.ndarray:
    """[3] N: an upward net force loses its share in the contact band."""
    if 0 <= height < alpha.contact_threshold:
        return force - alpha.ground_projection * max(0.0, force[2]) * np.array([0.0, 0.0, 1.0])
    return force


def contact(height: float, velocity: np.ndarray, dt: float, alpha: PhysicalParameters) -> tuple[np.ndarray, float]:
    """Velocity [3] after the table and the rise within the step, for a node that may reach it within `dt`."""
    if velocity[2] >= 0 or height + dt * velocity[2] >= 0:
        return velocity, dt * velocity[2]
    until_touch = min(max(height / -velocity[2], 0.0), dt)
    normal = -velocity[2]
    sliding = np.linalg.norm(velocity[:2])
    braked = max(0.0, sliding - alpha.friction * (1 + alpha.restitution) * normal)
    after = np.array([0.0, 0.0, alpha.restitution * normal])
    if sliding > 0:
        after[:2] = velocity[:2] * braked / sliding
    return after, until_touch * velocity[2] + (dt - until_touch) * after[2]


def new_grips(
    nodes: np.ndarray, controllers: np.ndarray, begins: np.ndarray, alpha: PhysicalParameters, *, flat: bool
) -> list[Grip]:
    """Springs of the contacts that begin now, as [C] `ContactKind`.

    A point that holds takes the nearest few within r_c; K_min = 5 where a flat object has fewer. One that presses
    touches the nearest node.
    """
    within: dict[int, list[int]] = {}
    nearest: dict[int, list[int]] = {}
    distance = np.linalg.norm(controllers[:, None] - nodes[None], axis=2)
    for controller in np.flatnonzero(begins):
        by_distance = sorted(range(len(nodes)), key=lambda node: (distance[controller, node], node))
        nearest[controller] = by_distance[: alpha.controller_neighbours]
        within[controller] = [
            node for node in nearest[controller] if distance[controller, node] <= alpha.controller_radius
        ]
    if flat or not any(within.values()):
        cutoff = max(2.5 * alpha.controller_radius, 0.15)
        for controller, found in within.items():
            if len(found) < 5:
                within[controller] = [node for node in nearest[controller][:5] if distance[controller, node] <= cutoff]
    for controller in np.flatnonzero(begins == ContactKind.PRESS):
        within[controller] = [int(distance[controller].argmin())]
    return [
        (node, int(controller), float(distance[controller, node]), ContactKind(begins[controller]))
        for controller, found in within.items()
        for node in found
    ]


def controller_motion(controls: Controls, frame: int, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities [C, 3] a share 0..1 into a frame: cubic Hermite.

    Its slope at a frame is that of the parabola through the frame and its neighbours, at the ends of the chord.
    """
    times, path = controls.times, controls.positions.astype(np.float64)

    def chord(at: int) -> np.ndarray:
        return (path[at + 1] - path[at]) / (times[at + 1] - times[at])

    def slope(at: int) -> np.ndarray:
        if at in (0, len(times) - 1):
            return chord(min(at, len(times) - 2))
        before, after = times[at] - times[at - 1], times[at + 1] - times[at]
        return (after * chord(at - 1) + before * chord(at)) / (before + after)

    h, t = times[frame + 1] - times[frame], share
    weights = (2 * t**3 - 3 * t**2 + 1, -2 * t**3 + 3 * t**2, h * (t**3 - 2 * t**2 + t), h * (t**3 - t**2))
    rates = (6 * t**2 - 6 * t, -6 * t**2 + 6 * t, h * (3 * t**2 - 4 * t + 1), h * (3 * t**2 - 2 * t))
    parts = (path[frame], path[frame + 1], slope(frame), slope(frame + 1))
    position = sum(weight * part for weight, part in zip(weights, parts, strict=True))
    velocity = sum(rate * part for rate, part in zip(rates, parts, strict=True)) / h
    return position, velocity


def simulate(
    batch: RolloutBatch,
    row: int,
    *,
    substeps: int | Sequence[int],
    extra: ExtraForce | None = None,
    laws: Sequence[ReferenceLaw] = (),
) -> np.ndarray:
    """[F, N, 3] float64 metres: one rollout of a batch.

    Args:
        substeps: of every frame, or of each [F - 1].
        extra: what the batch's node forces do, written again; they are not looked at themselves.
        laws: what its spring laws do, likewise; they remember, and serve one rollout.
    """
    alpha, controls = batch.parameters[row], batch.controls[row]
    masses = batch.masses[row].astype(np.float64)
    ground = batch.ground_height + alpha.contact_radius
    springs = [
        (
            int(i),
            int(j),
            {
                "stiffness": float(k),
                "damping": float(g),
                "rest": float(rest),
                "longest": float(longest),
                "compression_ratio": alpha.compression_ratio,
            },
        )
        for (i, j), k, g, rest, longest in zip(
            batch.springs,
            batch.stiffness[row],
            batch.damping[row],
            batch.rest_lengths[row],
            batch.longest_extensions[row],
            strict=True,
        )
    ]
    pairs = self_collision_pairs(batch.rest_positions.astype(np.float64), alpha.collision_distance)
    x, v = batch.positions[row].astype(np.float64), batch.velocities[row].astype(np.float64)
    hand, hand_velocity = controller_motion(controls, 0, 0.0)
    grips: list[Grip] = []
    before = np.zeros(controls.contact.shape[1], np.uint8)
    frames = [x.copy()]
    for frame, steps in enumerate(np.broadcast_to(substeps, len(controls.times) - 1)):
        now = controls.contact[frame].astype(np.uint8)
        grips = [grip for grip in grips if now[grip[1]] == before[grip[1]]]
        begins = np.where(now == before, ContactKind.NONE, now)
        grips += new_grips(x, controls.positions[frame].astype(np.float64), begins, alpha, flat=batch.flat)
        before = now
        dt = (controls.times[frame + 1] - controls.times[frame]) / steps
        for substep in range(steps):
            time = controls.times[frame] - controls.times[0] + substep * dt
            forces = np.zeros_like(x) if extra is None else extra(time, dt, x, v)
            for (i, j, numbers), factor, shift in zip(springs, *acting_laws(laws, springs, x, dt), strict=True):
                changed = numbers | {"stiffness": factor * numbers["stiffness"], "rest": (1 + shift) * numbers["rest"]}
                force = spring_force(x[j] - x[i], v[i] - v[j], **changed)
                forces[i] += force
                forces[j] -= force
            for held, controller, rest, kind in grips:
                numbers = {"stiffness": alpha.controller_stiffness, "damping": alpha.damping}
                for node in [held] if kind == ContactKind.HOLD else range(len(x)):
                    slip = v[node] - hand_velocity[controller]
                    if kind == ContactKind.HOLD:
                        away = hand[controller] - x[node]
                        forces[node] += spring_force(away, slip, rest=rest, longest=np.inf, **numbers)
                    else:
                        contact_numbers = {
                            "reach": rest,
                            "friction": alpha.collision_friction,
                            "stopping": masses[node] / dt,
                        }
                        forces[node] += press_force(x[node] - hand[controller], slip, **numbers, **contact_numbers)
            for node, mass in enumerate(masses):
                forces[node] += mass * (np.array([0.0, 0.0, -alpha.gravity]) - alpha.drag * v[node])
                inertia = mass * np.eye(3)
                if len(batch.across):
                    inertia += mass * alpha.added_mass * carrying(x[batch.across[node]])
                v[node] += dt * np.linalg.solve(inertia, projected(forces[node], x[node, 2] - ground, alpha))
            if pairs:
                _, v = self_collision.collide(
                    x, v, masses, pairs, restitution=alpha.collision_restitution, friction=alpha.collision_friction
                )
            for node in range(len(x)):
                v[node], rise = contact(x[node, 2] - ground, v[node], dt, alpha)
                x[node] += [dt * v[node, 0], dt * v[node, 1], rise]
            hand, hand_velocity = controller_motion(controls, frame, (substep + 1) / steps)
        frames.append(x.copy())
    return np.stack(frames)


def carrying(across: np.ndarray) -> np.ndarray:
    """[3, 3] n n^T of the normal between four nodes [4, 3] across one; 0 where they span no face."""
    normal = np.cross(across[1] - across[0], across[3] - across[2])
    size = np.linalg.norm(normal)
    return np.outer(normal, normal) / size**2 if size > 0 else np.zeros((3, 3))


def acting_laws(
    laws: Sequence[ReferenceLaw], springs: Sequence[tuple[int, int, dict[str, float]]], x: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """[E] product of the factors and sum of the shifts of all laws."""
    factors, shifts = np.ones(len(springs)), np.zeros(len(springs))
    if laws:
        strains = np.array([np.linalg.norm(x[j] - x[i]) / numbers["rest"] - 1 for i, j, numbers in springs])
        for law in laws:
            factor, shift = law(strains, dt)
            factors, shifts = factors * factor, shifts + shift
    return factors, shifts


def self_collision_pairs(rest_positions: np.ndarray, distance: float) -> list[self_collision.Pair]:
    """All pairs that are not neighbours on the object: a half circle of that diameter does not join them."""
    count = len(rest_positions) if distance > 0 else 0
    return [
        (i, j, distance)
        for i in range(count)
        for j in range(i + 1, count)
        if np.linalg.norm(rest_positions[j] - rest_positions[i]) > np.pi / 2 * distance
    ]
