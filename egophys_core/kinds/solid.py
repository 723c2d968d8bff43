"""Solids: plush toys. They are filled inside and have drag instead of bending springs and a limit of strain."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from egophys_core.effects.traits import Need
from egophys_core.kinds.kind import FittedParameter, FromSurface, Kind, RestShape, Searched, Touch, equal_masses
from egophys_core.kinds.kind import height_of_foot as resting_height
from egophys_core.kinds.spring_body import (
    TOTAL_MASS,
    VariantSizes,
    fitted,
    fitted_of_springs,
    searched_of_springs,
    spring_model,
    spring_variants,
)
from egophys_core.kinds.surface_faces import faces_of_body
from egophys_core.kinds.unseen_side import inside_of
from egophys_core.twin import GRAVITY, ObjectModel
from egophys_core.twin.statics import elongation_by_weight, with_elongation, with_weight_carried

NAME = "solid"

MOST_DAMPING = 30.0
"""Dashpot over node mass, 1/s."""

RADIUS, NEIGHBOURS = 2.5, 24
"""Length of the longest springs, in units of the node spacing, and how many a node asks for: with fewer a toy gives way
on the few nodes that it stands on, however stiff its springs are (docs/notes/pushes.md)."""

GRIP_SHARES = (0.4, 1.0)
"""Of the radius within which it moves with a hand, the part that is held: stuffing comes along beyond that. How wide it
is held decides how firmly it is kept from turning in the hand (docs/notes/grips.md)."""

SEARCHED = (
    Searched(name="stiffness_rate", low=3e4, high=1e6, start=3e5, logarithmic=True),
    *searched_of_springs(most_damping=MOST_DAMPING),
    Searched(name="drag", low=0.01, high=5.0, start=0.1, logarithmic=True),
    Searched(name="collision_friction", low=0.0, high=1.5, start=0.1, shown_by=Touch.PRESSED),
    Searched(name="grip_share", low=GRIP_SHARES[0], high=GRIP_SHARES[1], start=0.8, shown_by=Touch.HELD),
)

SIZES = VariantSizes(
    object_radii=(2.0, 2.5, 3.0),
    stiffness_rate=2e5,
    damping_rate=3.0,
    bending_ratios=(0.03,),
    compression_ratio=1.0,
    collides=False,
    bends=False,
)


def anything(points: np.ndarray) -> bool:
    """What is seen and is nothing else is a solid."""
    return True


def model_of(shape: RestShape, value: Mapping[str, float], ground_height: float) -> ObjectModel:
    """The model at searched values, with springs that carry its weight where it lies."""
    own = {name: value[name] for name in ("drag", "collision_friction")}
    own |= {"strain_limit": 1e6, "ground_projection": 0.0}
    value = {**value, "object_radius": RADIUS, "object_neighbours": NEIGHBOURS}
    rests_at = resting_height(shape.positions) - ground_height if shape.lies else 0.0
    held = replace(shape, grasp_radius=value["grip_share"] * shape.grasp_radius)
    model = spring_model(held, value, own, bends=False, rests_at=rests_at)
    if not shape.lies:
        return model
    compliance = 1.0 / model.parameters.stiffness
    elongation = compliance * _elongation(model.graph.positions.tobytes(), model.graph.springs.tobytes())
    return replace(model, graph=with_elongation(model.graph, elongation))


@lru_cache(maxsize=1)
def _elongation(positions: bytes, springs: bytes) -> np.ndarray:
    """[E] metres by which springs of 1 N/m carry the weight: the same for all candidates of a search."""
    nodes, pairs = np.frombuffer(positions, np.float32).reshape(-1, 3), np.frombuffer(springs, np.int32).reshape(-1, 2)
    return elongation_by_weight(
        nodes, pairs, np.ones(len(pairs)), np.full(len(nodes), GRAVITY * TOTAL_MASS / len(nodes))
    )


def fitted_parameters(model: ObjectModel) -> tuple[FittedParameter, ...]:
    """Its springs, its drag, and how much it weighs.

    A grip that is soft enough to turn in is too soft to carry: all toys sag too much in their twins. What a toy weighs,
    how stiff it is and how firmly it is held are one thing there: its static deflection is evidence for nothing.
    """
    return (
        *fitted_of_springs(model, most_damping=MOST_DAMPING),
        fitted("drag", 0.0, 20.0, 0.2, unit="1/s"),
        fitted("gravity", 0.5 * GRAVITY, 1.2 * GRAVITY, 0.5, unit="m/s^2"),
    )


def carrying_itself(model: ObjectModel) -> ObjectModel:
    """The solid with springs that carry its weight where it lies."""
    return with_weight_carried(model, equal_masses(model.graph, model.parameters.total_mass))


KIND = Kind(
    name=NAME,
    from_surface=FromSurface(recognises=anything, searched=SEARCHED, model=model_of, inside=inside_of),
    static_deflection_is_evidence=False,
    cannot_tell=frozenset({Need.THIN}),
    fitted=fitted_parameters,
    otherwise_at_rest=lambda model: [carrying_itself(model)],
    variants=lambda model: [
        [carrying_itself(each) for each in made_alike] for made_alike in spring_variants(model, SIZES)
    ],
    faces=lambda graph: faces_of_body(graph.positions),
)
