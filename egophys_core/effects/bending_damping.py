"""A sheet whose folding is damped more than its twin can be."""

from dataclasses import replace

import numpy as np

from egophys_core.effects.effect import Body, Effect, Parameter, Surroundings, Values
from egophys_core.effects.traits import Need, Traits


def adapt(values: Values, body: Body) -> Body:
    """The damping of bending springs times the factor."""
    return replace(body, damping=body.damping * np.where(body.bending, values["factor"], 1.0))


def starts(surroundings: Surroundings) -> list[dict[str, float]]:
    """One: nothing but the size is searched."""
    return [{"factor": 1.6}]


EFFECT = Effect(
    name="bending_damping",
    summary="a sheet whose folding is damped more; solids have no bending springs and do not change",
    equation="F = -factor c_bending (v_i - v_j)",
    source="Bridson, Marino and Fedkiw, Symp. on Computer Animation (2003) 28: damping of bending apart from stretch",
    parameters=(Parameter(name="factor", unit="1", low=1.0, high=50.0, step=0.5, null=1.0, logarithmic=True),),
    traits=Traits(
        confounders=("quadratic_drag", "viscoelasticity", "hysteresis"),
        experiment="flick a corner that hangs still and watch how long it flutters: bending dies out, the "
        "swing goes on",
        needs=frozenset({Need.SPRINGS}),
    ),
    starts=starts,
    adapt=adapt,
)
