"""The effects that act in every substep written again: float64, NumPy, straight from their equations."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tests.reference.simulator import ExtraForce, ReferenceLaw

BAND = 0.006
"""Metres above the table within which a node lies on it."""


def node_force(
    name: str,
    values: Mapping[str, float],
    *,
    start: np.ndarray,
    rest: np.ndarray,
    masses: np.ndarray,
    gravity: float,
    ground: float,
    begins: float,
) -> ExtraForce:
    """Newtons [N, 3] of an effect at a time, for positions and velocities [N, 3].

    Args:
        start: [N, 3] metres, where nodes are when the rollout begins.
        rest: [N, 3] metres, at rest where the twin was built.
        ground: z at which a node touches the table, metres.
        begins: seconds since the start of the episode.
    """
    v = values
    up = np.array([0.0, 0.0, 1.0])
    bearing = min(1.0 / np.mean(rest[:, 2] < rest[:, 2].min() + BAND), 4.0)

    def pressing(x: np.ndarray, change: np.ndarray) -> np.ndarray:
        lies = np.clip(1.0 - (x[:, 2] - ground) / BAND, 0.0, 1.0)
        return -gravity * bearing * (change * lies)[:, None] * up

    def drag(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        rate = v["coefficient"] * np.linalg.norm(w, axis=1, keepdims=True)
        return -np.minimum(rate, 1.0 / dt) * w

    def uniform(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        return np.tile([v["x"], v["y"], v["z"]], (len(x), 1))

    def gust(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        now, ends = begins + t, v["onset"] + v["duration"]
        share = max(min(now + dt, ends) - max(now, v["onset"]), 0.0) / dt
        oscillation = np.cos(2 * np.pi * v["frequency"] * (now + dt / 2 - v["onset"]) - v["phase"])
        return share * oscillation * uniform(t, dt, x, w)

    def tilt(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        axis = np.array([v["about_x"], v["about_y"], 0.0])
        angle = np.linalg.norm(axis)
        axis = axis / angle if angle > 0 else axis
        # Rodrigues' formula for the upright axis.
        turned = np.cos(angle) * up + np.sin(angle) * np.cross(axis, up) + (1 - np.cos(angle)) * (axis @ up) * axis
        return np.tile(-gravity * (turned - up), (len(x), 1))

    def attraction(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        d = (np.array([v["x"], v["y"], v["z"]]) - x) / v["range"]
        return v["strength"] * d * np.exp((1 - (d**2).sum(axis=1, keepdims=True)) / 2)

    def tether(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        squared = ((rest - [v["x"], v["y"], v["z"]]) ** 2).sum(axis=1)
        weights = np.exp((squared.min() - squared) / (2 * 0.01**2))
        weights /= weights.sum()
        d = weights @ start + [v["anchor_x"], v["anchor_y"], 0.0] - weights @ x
        distance = np.linalg.norm(d)
        pull = v["stiffness"] * max(distance - v["length"], 0.0) * d / max(distance, 1e-12)
        return masses.sum() * weights[:, None] * pull / masses[:, None]

    def adhesion(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        u = np.maximum(x[:, 2] - ground, 0.0) / v["reach"]
        return -v["strength"] * (u * np.exp(1 - u))[:, None] * up

    def patch(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        outside = np.linalg.norm(x[:, :2] - [v["x"], v["y"]], axis=1) / v["radius"] - 1.0
        return pressing(x, v["change"] * np.clip(0.5 - outside / 0.25, 0.0, 1.0))

    def stiction(t: float, dt: float, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        return pressing(x, v["rise"] * np.exp(-(w[:, :2] ** 2).sum(axis=1) / v["speed"] ** 2))

    accelerations: dict[str, Callable[..., np.ndarray]] = {
        "quadratic_drag": drag,
        "constant_body_force": uniform,
        "time_varying_body_force": gust,
        "gravity_tilt": tilt,
        "point_attraction": attraction,
        "hidden_tether": tether,
        "table_adhesion": adhesion,
        "place_dependent_friction": patch,
        "stribeck_friction": stiction,
    }
    return lambda time, dt, x, w: masses[:, None] * accelerations[name](time, dt, x, w)


def spring_law(name: str, values: Mapping[str, float]) -> ReferenceLaw:
    """From strains [E] and seconds of a substep to F / (k l0) over the strain, as factor and shift; it remembers."""
    v, memory = values, dict[str, Any]()

    def stiffening(e: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        return 1 + np.minimum(v["coefficient"] * np.maximum(e, 0) ** 2, 6.0), 0 * e

    def asymmetry(e: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        return np.where(e < 0, 1 + v["change"], 1.0), 0 * e

    def relaxing(e: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        q = memory.get("q", 0 * e)
        memory["q"] = e - (e - q) * np.exp(-dt / v["time"])
        return np.full_like(e, 1 + v["ratio"]), v["ratio"] / (1 + v["ratio"]) * q

    def flowing(e: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        p = memory.get("p", 0 * e)
        beyond = np.sign(e - p) * np.maximum(np.abs(e - p) - v["yield_strain"], 0.0)
        memory["p"] = np.clip(p + beyond * (1 - np.exp(-v["flow"] * dt)), -0.8, 0.8)
        return np.ones_like(e), p

    def rubbing(e: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        z, before = memory.get("z", 0 * e), memory.get("e", e)
        change, direction = np.abs(e - before) / v["strain"], np.sign(e - before)
        back = np.minimum(change, np.maximum(-direction * z, 0.0))
        memory["z"] = z + direction * (back + (1 - np.maximum(direction * z, 0.0)) * (1 - np.exp(back - change)))
        memory["e"] = e
        # Elastic within the step: F = e + strength (e - before) + strength scale z.
        force = e + v["strength"] * (e - before) + v["strength"] * v["strain"] * z
        factor = np.full_like(e, 1 + v["strength"])
        return factor, e - force / factor

    laws = {
        "strain_stiffening": stiffening,
        "tension_compression_asymmetry": asymmetry,
        "viscoelasticity": relaxing,
        "plasticity": flowing,
        "hysteresis": rubbing,
    }
    return laws[name]
