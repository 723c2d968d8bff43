"""Traits of the library agree: names exist, special cases make no circle, equivalence goes both ways."""

import numpy as np
import pytest

from egophys_core.effects import LIBRARY, Effect
from egophys_core.effects.traits import Measurement

EFFECTS = pytest.mark.parametrize("effect", LIBRARY.values(), ids=LIBRARY.keys())


@EFFECTS
def test_other_effects_that_are_named_exist_and_are_others(effect: Effect):
    traits = effect.traits
    named = {*traits.confounders, *traits.special_cases, *traits.equivalent_to, *traits.equivalent_in_air}
    assert named <= LIBRARY.keys() - {effect.name}
    assert traits.confounders
    assert traits.experiment


@EFFECTS
def test_equivalence_goes_both_ways(effect: Effect):
    for other in effect.traits.equivalent_to:
        assert effect.name in LIBRARY[other].traits.equivalent_to
    for other in effect.traits.equivalent_in_air:
        assert effect.name in LIBRARY[other].traits.equivalent_in_air


def test_special_cases_make_no_circle():
    simple: set[str] = set()
    while len(simple) < len(LIBRARY):
        more = {name for name, effect in LIBRARY.items() if simple.issuperset(effect.traits.special_cases)} - simple
        assert more, f"a circle among {LIBRARY.keys() - simple}"
        simple |= more


@EFFECTS
def test_a_degenerate_parameter_says_how_not_how_much(effect: Effect):
    name = effect.traits.degenerate_parameter
    assert name is None or {each.name: each.null for each in effect.parameters}[name] is None


@EFFECTS
def test_what_is_measured_directly_has_the_map_that_it_is_measured_by(effect: Effect):
    has_map = {
        Measurement.GRIPS: any((effect.clock, effect.drive, effect.slide)),
        Measurement.TABLE_LEVEL: effect.frame is not None,
        Measurement.PLUMB_LINE: effect.plumb is not None,
        Measurement.FREE_FALL: effect.falls is not None,
        Measurement.RING_DOWN: effect.traits.degenerate_parameter is not None and len(effect.parameters) == 2,
    }
    assert all(has_map[each] for each in effect.traits.measured_by)


@EFFECTS
def test_only_what_has_an_equivalent_is_called_horizontal(effect: Effect):
    values = {each.name: each.high for each in effect.parameters}
    if effect.traits.is_horizontal(values):
        assert effect.traits.equivalent_to


@EFFECTS
def test_predicates_take_any_values_of_their_effect(effect: Effect):
    rest = np.random.default_rng(0).uniform(-0.1, 0.1, (20, 3))
    for values in (
        {each.name: each.low for each in effect.parameters},
        {each.name: each.high for each in effect.parameters},
    ):
        traits = effect.traits
        found = (traits.is_horizontal(values), traits.is_vertical(values), traits.is_implausible(values, rest))
        assert all(isinstance(each, bool) for each in found)
