"""An effect from outside, from its definition to its diagnosis: nothing but this file knows of it."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from egophys_core.diagnosis.diagnose import diagnose
from egophys_core.diagnosis.diagnosis import Outcome
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.effects import LIBRARY, NAMES, Effect, Parameter, TwinEffect, added
from egophys_core.effects.effect import Body, NodeForce, Values
from egophys_core.effects.traits import Traits
from egophys_core.errors import TwinError
from egophys_core.lanes import Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays
from egophys_core.simulation import batch_of_models, effect_gradients, rollout
from egophys_core.simulation.gradients import differentiate
from egophys_core.twin import load_twin, save_twin
from tests.diagnosis.rehearsed import episodes, sheet
from tests.effects.situations import run
from tests.simulation.differences import linear_loss
from tests.simulation.scenes import FAR_BELOW, frame_times, idle_controls, sheet_model
from tests.twin.examples import make_twin


@wp.func
def add_whirl(
    group: int,
    first: int,
    last: int,
    column: int,
    time: Lanes,
    dt: Lanes,
    state: StateArrays,
    parameters: ParameterArrays,
    numbers: wp.array2d(dtype=Lanes),
    forces: wp.array3d(dtype=Lanes),
):
    """Add m rate z x v, N."""
    for node in range(first, last):
        strength = wp.cw_mul(parameters.masses[group, node], numbers[group, column])
        forces[group, node, 0] -= wp.cw_mul(strength, state.velocities[group, node, 1])
        forces[group, node, 1] += wp.cw_mul(strength, state.velocities[group, node, 0])


def rate_of(values: Values, body: Body) -> np.ndarray:
    return np.array([values["rate"]])


WHIRL = Effect(
    name="whirl",
    summary="what moves is turned to the left",
    equation="a = rate z x v",
    source="Landau and Lifshitz, Mechanics (1976), sec. 39: the force of Coriolis",
    parameters=(Parameter(name="rate", unit="1/s", low=-20.0, high=20.0, step=0.5, null=0.0),),
    traits=Traits(confounders=("quadratic_drag",), experiment="throw it, and look whether it flies straight"),
    starts=lambda surroundings: [{"rate": 0.5}],
    node_force=NodeForce(function=add_whirl, numbers=rate_of),
)

RATE = 6.0


@pytest.fixture(autouse=True)
def whirl():
    with added(WHIRL):
        yield TwinEffect(name="whirl", values={"rate": RATE})


def test_what_is_thrown_goes_round(whirl):
    model = replace(sheet_model(gravity=0.0, drag=0.0), effects=(whirl,))
    velocity = run(model, velocity=(0.5, 0.0, 0.0), duration=0.3).velocities[0].mean(axis=0)
    assert velocity == pytest.approx(0.5 * np.array([np.cos(0.3 * RATE), np.sin(0.3 * RATE), 0.0]), abs=0.01)


def test_it_has_a_gradient(whirl):
    times, speed = frame_times(0.05, 0.01), np.full((16, 3), 0.4)
    scene = {"velocities": [speed], "ground_height": FAR_BELOW}

    def model_at(rate: float):
        return replace(sheet_model(), effects=(replace(whirl, values={"rate": rate}),))

    weights = np.random.default_rng(0).normal(0, 1, (len(times), 16, 3))
    hands = [idle_controls(times)]
    batch = batch_of_models([model_at(RATE)], hands, **scene)
    gradient = differentiate(batch, linear_loss(weights))[2]
    found = effect_gradients([model_at(RATE)], hands, gradient, **scene)[0]["whirl"]["rate"]
    ends = [rollout(batch_of_models([model_at(RATE + by)], hands, **scene)).positions[0] for by in (1.0, -1.0)]
    assert found == pytest.approx(float((weights * (ends[0].astype(float) - ends[1])).sum()) / 2.0, rel=5e-3)


def test_it_is_saved_and_loaded_with_a_twin(whirl, tmp_path):
    twin = make_twin(replace(sheet_model(), effects=(whirl,)))
    save_twin(twin, tmp_path / "whirl.twin")
    assert load_twin(tmp_path / "whirl.twin").model.effects == (whirl,)


@pytest.mark.slow
def test_it_is_diagnosed(whirl):
    quick = DiagnosisOptions(baseline_starts=2, shortlist=2, refit_iterations=3, surrogates=40, bootstraps=100)
    strong = replace(whirl, values={"rate": 9.0})
    diagnosis = diagnose(make_twin(sheet()), episodes(strong), quick, without=NAMES).diagnosis
    assert diagnosis.outcome == Outcome.NAMED
    assert diagnosis.effects[0].name == "whirl"
    assert diagnosis.effects[0].parameters["rate"].value == pytest.approx(9.0, rel=0.25)


def test_a_name_is_given_once():
    assert "whirl" in LIBRARY
    with pytest.raises(TwinError, match="the library has an effect 'whirl' already"), added(replace(WHIRL, source="?")):
        pass
