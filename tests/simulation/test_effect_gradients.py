"""Gradients by the parameters of every effect, against central differences of the float64 reference."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from egophys_core.effects import LIBRARY, NAMES, TwinEffect
from egophys_core.effects.rotations import rotation
from egophys_core.simulation import ContactKind, Controls, RolloutBatch, batch_of_models
from egophys_core.simulation.effect_gradients import effect_gradients
from egophys_core.simulation.frames import into_record
from egophys_core.simulation.gradients import differentiate
from egophys_core.twin import ObjectModel, SpringGraph, SpringKind
from tests.reference.effects import node_force, spring_law
from tests.reference.simulator import simulate
from tests.simulation.differences import linear_loss, substeps_of
from tests.simulation.gradient_scenes import lengths, net
from tests.simulation.scenes import parameters

RELATIVE = 1e-3
"""What a derivative may be off by, of the largest one of its effect, each times its parameter's step."""

CHANGE = 1e-6
"""Of a parameter's step, for the differences of the reference."""

GROUND, TOUCHES = 0.1, 0.103
"""Metres: the table, and where a node touches it."""

MIDDLE = net(np.random.default_rng(5))[4:].mean(axis=0) + 0.0004
"""Metres: a thread holds the last two nodes there."""

VALUES: dict[str, dict[str, float]] = {
    "quadratic_drag": {"coefficient": 3.0},
    "constant_body_force": {"x": 0.5, "y": -1.0, "z": 0.7},
    "time_varying_body_force": {
        **{"x": 2.0, "y": 1.0, "z": -1.0},
        **{"onset": 0.0123, "duration": 0.0311, "frequency": 4.0, "phase": 0.4},
    },
    "gravity_scale": {"scale": 0.8},
    "gravity_tilt": {"about_x": 0.1, "about_y": -0.2},
    "point_attraction": {"x": 0.15, "y": 0.0, "z": 0.2, "strength": 3.0, "range": 0.15},
    "hidden_tether": {
        **{"x": MIDDLE[0], "y": MIDDLE[1], "z": 0.1, "anchor_x": 0.05, "anchor_y": -0.03},
        **{"stiffness": 30.0, "length": 0.02},
    },
    "table_adhesion": {"strength": 3.0, "reach": 0.01},
    "place_dependent_friction": {"x": 0.12, "y": 0.06, "radius": 0.1, "change": 0.7},
    "stribeck_friction": {"rise": 1.2, "speed": 0.4},
    "uneven_mass": {"x": 0.05, "y": 0.01, "z": 0.0, "radius": 0.06, "fraction": 0.5},
    "strain_stiffening": {"coefficient": 20.0},
    "tension_compression_asymmetry": {"change": 0.4},
    "anisotropy": {"cosine": 0.3, "sine": -0.2},
    "added_mass": {"ratio": 0.7},
    "bending_damping": {"factor": 1.7},
    "viscoelasticity": {"ratio": 0.6, "time": 0.04},
    "plasticity": {"flow": 12.0, "yield_strain": 0.03},
    "hysteresis": {"strength": 0.7, "strain": 0.04},
    "control_delay": {"delay": 0.0037},
    "tracking_scale": {"scale": 1.04},
    "tracking_rotation": {"about_x": 0.1, "about_y": -0.2},
    "tracking_offset": {"x": 0.004, "y": -0.003, "z": 0.005},
    "gripper_offset": {"x": 0.004, "y": -0.003, "z": 0.005},
}
"""Away from where anything jumps; a slip, which follows a pull, is in `test_sliding_grips.py`."""


def model_of(*names: str) -> ObjectModel:
    """A net on the table with a bending spring, and effects."""
    generator = np.random.default_rng(5)
    positions = net(generator, height=TOUCHES + 0.0003)
    springs = np.array([(0, 1), (0, 2), (0, 3), (1, 3), (2, 3), (2, 4), (3, 4), (3, 5), (4, 5)], np.int32)
    kinds = np.zeros(len(springs), np.uint8)
    kinds[[2, 6]] = SpringKind.BENDING
    return ObjectModel(
        kind="sheet",
        graph=SpringGraph(
            positions=positions.astype(np.float32),
            springs=springs,
            kinds=kinds,
            rest_lengths=(lengths(positions, springs) * generator.uniform(0.88, 1.12, len(springs))).astype(np.float32),
            surface=np.ones(len(positions), bool),
        ),
        parameters=parameters(
            total_mass=0.12,
            damping=0.03,
            bending_damping_ratio=1.3,
            gravity=9.81,
            drag=0.4,
            strain_limit=0.4,
            compression_ratio=0.8,
            friction=0.3,
            restitution=0.15,
            contact_radius=TOUCHES - GROUND,
            contact_threshold=0.002,
            ground_projection=0.3,
            controller_stiffness=15.0,
            controller_radius=0.05,
            controller_neighbours=1,
        ),
        stiffness=np.full(len(springs), 8.0, np.float32),
        effects=tuple(TwinEffect(name=name, values=VALUES[name]) for name in names),
    )


def turning_hand(model: ObjectModel) -> Controls:
    """Three points that take hold of the first node, lift it and turn."""
    times = np.array([0.0, 0.01, 0.022, 0.035, 0.05, 0.065])
    shape = np.array([[0.02, 0, 0.01], [-0.01, 0.015, 0.02], [0, -0.02, 0.015]])
    turns = np.array([rotation(np.array([0.0, 2.0 * time, 5.0 * time])) for time in times])
    displacement = times[:, None] * [0.4, 0.2, 0.1] + times[:, None] ** 2 * [3.0, 2.0, 10.0]
    path = np.einsum("fij,cj->fci", turns, shape) + displacement[:, None] + model.graph.positions[0]
    contact = np.full(path.shape[:2], ContactKind.HOLD, np.uint8)
    return Controls(times=times, positions=path.astype(np.float32), contact=contact)


def speeds() -> np.ndarray:
    """[6, 3] m/s: it slides."""
    return np.random.default_rng(6).normal(0, 0.05, (6, 3)) * [1, 1, 0] + [0.5, 0.2, 0]


def batch_at(model: ObjectModel, controls: Controls, **options) -> RolloutBatch:
    return batch_of_models([model], [controls], velocities=[speeds()], ground_height=GROUND, **options)


def reference_positions(model: ObjectModel, controls: Controls, substeps: np.ndarray) -> np.ndarray:
    """[F, N, 3] metres, float64, as they are recorded."""
    batch = batch_at(model, controls, dtype=np.float64)
    forces, laws = [], []
    for term in model.effects:
        if LIBRARY[term.name].spring_law:
            laws.append(spring_law(term.name, term.values))
        if LIBRARY[term.name].node_force:
            known = {
                "start": batch.positions[0],
                "rest": model.graph.positions.astype(np.float64),
                "masses": batch.masses[0],
                "gravity": batch.parameters[0].gravity,
                "ground": GROUND + model.parameters.contact_radius,
                "begins": float(controls.times[0]),
            }
            forces.append(node_force(term.name, term.values, **known))
    positions = simulate(
        batch,
        0,
        substeps=substeps,
        extra=lambda *now: sum(force(*now) for force in forces) if forces else np.zeros_like(now[2]),
        laws=laws,
    )
    return positions if batch.frames is None else into_record(positions[None], batch.frames)[0]


@cache
def derivatives(*names: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Of a random loss, times the parameters' steps: by the gradient, by differences, and of which parameters."""
    model = model_of(*names)
    controls = turning_hand(model)
    weights = np.random.default_rng(0).normal(0, 1, (6, 6, 3))
    batch = batch_at(model, controls)
    result, losses, gradient = differentiate(batch, linear_loss(weights))
    result.raise_on_failure()
    substeps = substeps_of(batch)
    exact = float((weights * reference_positions(model, controls, substeps)).sum())
    assert losses[0] == pytest.approx(exact, abs=3e-5)
    found = effect_gradients([model], [controls], gradient, velocities=[speeds()], ground_height=GROUND)[0]
    by_gradient, by_differences, labels = [], [], []
    for index, term in enumerate(model.effects):
        for each in LIBRARY[term.name].parameters:
            ends = []
            for by in (CHANGE * each.step, -CHANGE * each.step):
                other = replace(term, values={**term.values, each.name: term.values[each.name] + by})
                changed = replace(model, effects=(*model.effects[:index], other, *model.effects[index + 1 :]))
                ends.append(float((weights * reference_positions(changed, controls, substeps)).sum()))
            by_differences.append((ends[0] - ends[1]) / (2 * CHANGE))
            by_gradient.append(found[term.name][each.name] * each.step)
            labels.append(f"{term.name} {each.name}")
    return np.array(by_gradient), np.array(by_differences), labels


@pytest.mark.parametrize(
    "names",
    [
        *((name,) for name in NAMES if not LIBRARY[name].slide),
        ("viscoelasticity", "hysteresis", "hidden_tether", "tracking_scale"),
        ("plasticity", "strain_stiffening", "tracking_rotation", "stribeck_friction"),
    ],
    ids=" ".join,
)
def test_gradient_by_parameters_agrees_with_central_differences(names):
    found, exact, labels = derivatives(*names)
    # At which height a thread is tied, or added mass is, says nothing of an object that lies flat.
    told = [label for label, each in zip(labels, exact, strict=True) if each != 0.0]
    assert told == [label for label in labels if label not in ("hidden_tether z", "uneven_mass z")]
    assert np.abs(found - exact).max() < RELATIVE * np.abs(exact).max(), list(zip(labels, found, exact, strict=True))
