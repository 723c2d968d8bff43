"""What holds for every effect: complete, within bounds, and gone at its null."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import at_null
from egophys_core.diagnosis.hypotheses.ranking import simulated_starts
from egophys_core.effects import LIBRARY, TwinEffect, effect_named
from egophys_core.errors import TwinError
from egophys_core.simulation import batch_of_models, rollout
from tests.effects.situations import lifted, sheet, solid, surroundings

NAMES = sorted(LIBRARY)
MOST_SIMULATED = 32
"""Starts, or pieces of them: four groups of lanes; an added mass in a solid has 26."""


def test_the_library_is_complete():
    assert list(LIBRARY) == [
        "quadratic_drag",
        "constant_body_force",
        "time_varying_body_force",
        "added_mass",
        "gravity_scale",
        "gravity_tilt",
        "point_attraction",
        "hidden_tether",
        "table_adhesion",
        "place_dependent_friction",
        "stribeck_friction",
        "uneven_mass",
        "strain_stiffening",
        "tension_compression_asymmetry",
        "anisotropy",
        "bending_damping",
        "viscoelasticity",
        "plasticity",
        "hysteresis",
        "grasp_slip",
        "control_delay",
        "tracking_scale",
        "tracking_rotation",
        "tracking_offset",
        "gripper_offset",
    ]


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_says_what_it_is_and_what_it_is_taken_for(name):
    effect = LIBRARY[name]
    assert effect.summary
    assert "=" in effect.equation
    assert effect.source
    assert effect.traits.experiment
    hooks = (effect.node_force, effect.spring_law, effect.adapt, effect.drive, effect.slide, effect.clock)
    assert any(each is not None for each in (*hooks, effect.frame))
    assert effect.traits.confounders
    assert set(effect.traits.confounders) <= set(LIBRARY) - {name}


@pytest.mark.parametrize("name", NAMES)
def test_parameters_have_bounds_and_a_null_between_them(name):
    parameters = LIBRARY[name].parameters
    assert any(each.null is not None for each in parameters)
    for each in parameters:
        assert each.low < each.high
        assert each.step > 0
        assert each.low > 0 or not each.logarithmic
        assert each.null is None or each.low <= each.null <= each.high


def test_few_starts_of_an_effect_whose_load_is_a_sum_are_simulated_themselves():
    effect, around = LIBRARY["time_varying_body_force"], surroundings(sheet())
    starts = effect.starts(around)
    assert len(simulated_starts(effect, around, starts)[0]) < len(starts)
    simulated, shares = simulated_starts(effect, around, starts[:3])
    assert simulated == starts[:3]
    np.testing.assert_array_equal(shares, np.eye(3))


@pytest.mark.parametrize("make", [sheet, solid])
@pytest.mark.parametrize("name", NAMES)
def test_starts_are_complete_distinct_and_away_from_the_null(name, make):
    effect = LIBRARY[name]
    around = surroundings(make())
    starts = effect.starts(around)
    assert 1 <= len(simulated_starts(effect, around, starts)[0]) <= MOST_SIMULATED
    assert len({tuple(start.values()) for start in starts}) == len(starts)
    for start in starts:
        assert set(start) == {each.name for each in effect.parameters}
        for each in effect.parameters:
            assert each.low <= start[each.name] <= each.high, each.name
            assert start[each.name] != each.null, each.name


@pytest.mark.parametrize("make", [sheet, solid])
def test_at_its_null_an_effect_changes_nothing_to_the_bit(make):
    model, known = make(), surroundings(make())
    cases = [(name, at_null(LIBRARY[name], start)) for name in NAMES for start in LIBRARY[name].starts(known)]
    models = [model, *(replace(model, effects=(TwinEffect(name=name, values=values),)) for name, values in cases)]
    result = rollout(batch_of_models(models, [lifted()] * len(models), ground_height=0.0))
    result.raise_on_failure()
    plain = rollout(batch_of_models([model], [lifted()], ground_height=0.0))
    assert np.abs(result.positions[0] - plain.positions[0]).max() < 1e-6
    for (name, _), positions in zip(cases, result.positions[1:], strict=True):
        assert (positions == result.positions[0]).all(), name


@pytest.mark.parametrize("make", [sheet, solid])
def test_away_from_its_null_an_effect_shows_but_for_those_of_sheets_alone(make):
    model = make()
    # From 0.1 s on, whatever a start says of when: the episode is short.
    early = {"onset": 0.1}
    starts = {name: LIBRARY[name].starts(surroundings(model))[0] for name in NAMES}
    values = [{**starts[name], **{key: early[key] for key in early if key in starts[name]}} for name in NAMES]
    models = [
        replace(model, effects=(TwinEffect(name=name, values=each),)) for name, each in zip(NAMES, values, strict=True)
    ]
    controls = lifted(duration=1.0, height=0.2)
    result = rollout(batch_of_models([model, *models], [controls] * (1 + len(NAMES)), ground_height=0.0))
    result.raise_on_failure()
    moved = np.abs(result.positions[1:] - result.positions[0]).max(axis=(1, 2, 3))
    silent = {name for name, distance in zip(NAMES, moved, strict=True) if distance < 1e-5}
    assert silent == (set() if make is sheet else {"added_mass", "bending_damping"})


def test_an_unknown_effect_names_its_nearest():
    with pytest.raises(TwinError, match="did you mean quadratic_drag"):
        effect_named("quadratic_drak")
