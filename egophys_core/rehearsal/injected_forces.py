"""From the injected effects to the terms of force of a step."""

import numpy as np

from egophys_core.rehearsal import bending_forces, carried_air, edge_forces, field_forces, table_forces
from egophys_core.rehearsal.bodies import SoftBody
from egophys_core.rehearsal.engine import FlexEngine
from egophys_core.rehearsal.injection import Effects
from egophys_core.rehearsal.state import ForceTerm

FIELDS = {
    "quadratic_drag": field_forces.quadratic_drag,
    "constant_body_force": field_forces.constant_body_force,
    "time_varying_body_force": field_forces.time_varying_body_force,
    "point_attraction": field_forces.point_attraction,
}

FRICTIONS = {
    "place_dependent_friction": table_forces.place_dependent_friction,
    "stribeck_friction": table_forces.stribeck_friction,
}
"""Those that need to know how hard the table presses."""

LAWS = {
    "strain_stiffening": edge_forces.strain_stiffening,
    "tension_compression_asymmetry": edge_forces.tension_compression_asymmetry,
    "anisotropy": edge_forces.anisotropy,
    "viscoelasticity": edge_forces.viscoelasticity,
    "hysteresis": edge_forces.hysteresis,
}

MATERIAL = {*LAWS, "plasticity"}
"""Those that make the body stiffer than MuJoCo knows."""


def injected_terms(effects: Effects, body: SoftBody, engine: FlexEngine) -> list[ForceTerm]:
    """The terms; changes the engine's friction where an injected one only adds to it."""
    terms = [make(effects[name]) for name, make in FIELDS.items() if name in effects]
    if "hidden_tether" in effects:
        terms.append(field_forces.hidden_tether(effects["hidden_tether"], body.vertices))
    if "table_adhesion" in effects:
        terms.append(table_forces.table_adhesion(effects["table_adhesion"], vertex_areas(body)))
    terms += [make(effects[name], body.friction) for name, make in FRICTIONS.items() if name in effects]
    if "place_dependent_friction" in effects:
        engine.set_friction(body.friction * min(1.0, 1.0 + effects["place_dependent_friction"]["change"]))
    edges = edge_forces.make_edges(body, engine.edges)
    laws = [make(effects[name], edges) for name, make in LAWS.items() if name in effects]
    if laws:
        terms.append(edge_forces.edge_tensions(edges, laws, len(body.vertices)))
    if "plasticity" in effects:
        terms.append(edge_forces.plasticity(effects["plasticity"], edges, engine.edge_rest_lengths))
    if "added_mass" in effects:
        terms.append(carried_air.added_mass(effects["added_mass"], body))
    if "bending_damping" in effects:
        terms.append(bending_forces.bending_damping(effects["bending_damping"], body))
    return terms


def vertex_areas(body: SoftBody) -> np.ndarray:
    """[V] m^2: a third of the surface triangles around each vertex."""
    corners = body.vertices[body.surface]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.bincount(body.surface.ravel(), np.repeat(areas / 3.0, 3), len(body.vertices))
