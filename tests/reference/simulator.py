"""The simulator written again: float64, NumPy, one spring after the other, straight from the paper's equations.

Slow and plain on purpose; shares no code with `egophys_core.simulation` but the types it is called with.
"""

import numpy as np

from egophys_core.simulation import Controls, RolloutBatch
from egophys_core.twin import PhysicalParameters

Spring = tuple[int, int, float, float, float]
"""Node, node, stiffness N/m, dashpot N s/m, rest length m."""
Hold = tuple[int, int, float]
"""Node, controller point, rest length m."""


def spring_force(
    offset: np.ndarray, relative_velocity: np.ndarray, *, stiffness: float, damping: float, rest: float, limit: float
) -> np.ndarray:
    """[3] N on the first node: k eta (l - l0) d - gamma (v_i - v_j), eta = min(1, limit / strain) when stretched.

    Args:
        offset: [3] x_j - x_i, metres.
        relative_velocity: [3] v_i - v_j, m/s.
        stiffness: k, N/m.
        damping: gamma, N s/m.
        rest: l0, metres.
        limit: strain beyond which the spring softens.
    """
    length = float(np.linalg.norm(offset))
    strain = (length - rest) / rest
    eta = min(1.0, limit / strain) if strain > 0 else 1.0
    direction = offset / length if length > 0 else np.zeros(3)
    return stiffness * eta * (length - rest) * direction - damping * relative_velocity


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


def new_holds(
    nodes: np.ndarray, controllers: np.ndarray, takes_hold: np.ndarray, alpha: PhysicalParameters, *, flat: bool
) -> list[Hold]:
    """Springs of the points that take hold now: within r_c the nearest few; K_min = 5 where a flat object has fewer."""
    within: dict[int, list[int]] = {}
    nearest: dict[int, list[int]] = {}
    distance = np.linalg.norm(controllers[:, None] - nodes[None], axis=2)
    for controller in np.flatnonzero(takes_hold):
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
    return [
        (node, int(controller), float(distance[controller, node]))
        for controller, found in within.items()
        for node in found
    ]


def controller_motion(controls: Controls, frame: int, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities [C, 3] a share 0..1 into a frame: cubic Hermite with central differences as slopes."""
    times, path = controls.times, controls.positions.astype(np.float64)

    def slope(at: int) -> np.ndarray:
        before, after = max(at - 1, 0), min(at + 1, len(times) - 1)
        return (path[after] - path[before]) / (times[after] - times[before])

    h, t = times[frame + 1] - times[frame], share
    weights = (2 * t**3 - 3 * t**2 + 1, -2 * t**3 + 3 * t**2, h * (t**3 - 2 * t**2 + t), h * (t**3 - t**2))
    rates = (6 * t**2 - 6 * t, -6 * t**2 + 6 * t, h * (3 * t**2 - 4 * t + 1), h * (3 * t**2 - 2 * t))
    parts = (path[frame], path[frame + 1], slope(frame), slope(frame + 1))
    position = sum(weight * part for weight, part in zip(weights, parts, strict=True))
    velocity = sum(rate * part for rate, part in zip(rates, parts, strict=True)) / h
    return position, velocity


def simulate(batch: RolloutBatch, row: int, *, substeps: int) -> np.ndarray:
    """[F, N, 3] float64 metres: one rollout of a batch on equally long frames of `substeps` substeps."""
    alpha, controls = batch.parameters[row], batch.controls[row]
    masses = batch.masses[row].astype(np.float64)
    ground = batch.ground_height + alpha.contact_radius
    springs: list[Spring] = [
        (int(i), int(j), float(k), float(g), float(rest))
        for (i, j), k, g, rest in zip(
            batch.springs, batch.stiffness[row], batch.damping[row], batch.rest_lengths[row], strict=True
        )
    ]
    x, v = batch.positions[row].astype(np.float64), batch.velocities[row].astype(np.float64)
    hand, hand_velocity = controller_motion(controls, 0, 0.0)
    holds: list[Hold] = []
    held = np.zeros(controls.hold.shape[1], bool)
    frames = [x.copy()]
    for frame in range(len(controls.times) - 1):
        now = controls.hold[frame]
        holds = [hold for hold in holds if now[hold[1]]]
        holds += new_holds(x, controls.positions[frame].astype(np.float64), now & ~held, alpha, flat=batch.flat)
        held = now
        dt = (controls.times[frame + 1] - controls.times[frame]) / substeps
        for substep in range(substeps):
            forces = np.zeros_like(x)
            for i, j, k, g, rest in springs:
                force = spring_force(
                    x[j] - x[i], v[i] - v[j], stiffness=k, damping=g, rest=rest, limit=alpha.strain_limit
                )
                forces[i] += force
                forces[j] -= force
            for node, controller, rest in holds:
                forces[node] += spring_force(
                    hand[controller] - x[node],
                    v[node] - hand_velocity[controller],
                    stiffness=alpha.controller_stiffness,
                    damping=alpha.damping,
                    rest=rest,
                    limit=np.inf,
                )
            for node, mass in enumerate(masses):
                forces[node] += mass * (np.array([0.0, 0.0, -alpha.gravity]) - alpha.drag * v[node])
                forces[node] = projected(forces[node], x[node, 2] - ground, alpha)
                v[node], rise = contact(x[node, 2] - ground, v[node] + dt * forces[node] / mass, dt, alpha)
                x[node] += [dt * v[node, 0], dt * v[node, 1], rise]
            hand, hand_velocity = controller_motion(controls, frame, (substep + 1) / substeps)
        frames.append(x.copy())
    return np.stack(frames)
