"""Options of a room, as they come from YAML, JSON, the command line or ROS parameters."""

from dataclasses import dataclass
from enum import StrEnum

import pytest
import yaml

from egophys_core.errors import OptionsError
from egophys_core.identification import FitOptions
from egophys_core.options import choice, from_mapping, number, to_mapping, validate
from egophys_core.planning import PlanOptions


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True, kw_only=True)
class Example:
    count: int = number(3, low=1, high=10, doc="how many")
    share: float = number(0.5, low=0.0, high=1.0, doc="how much")
    colour: Colour = choice(Colour.RED, doc="which")  # noqa: RUF009
    corner_m: tuple[float, float, float] = number((0.0, 1.0, 2.0), low=-5.0, high=5.0, doc="where")
    loud: bool = False

    def __post_init__(self) -> None:
        validate(self)


def test_values_are_taken_and_converted():
    options = from_mapping(Example, {"count": 4, "share": 1, "colour": "blue", "corner_m": [1, 2, 3.5], "loud": True})
    assert options == Example(count=4, share=1.0, colour=Colour.BLUE, corner_m=(1.0, 2.0, 3.5), loud=True)
    assert isinstance(options.share, float)
    assert isinstance(options.corner_m, tuple)
    assert all(isinstance(each, float) for each in options.corner_m)


@pytest.mark.parametrize(
    ("written", "options"),
    [
        ("count: 4.0", Example(count=4)),
        ("count: 1e1", Example(count=10)),
        ("share: 1e-3", Example(share=0.001)),
        ("corner_m: [1e-3, 1, 2.0]", Example(corner_m=(0.001, 1.0, 2.0))),
    ],
)
def test_numbers_are_taken_however_yaml_reads_them(written, options):
    found = from_mapping(Example, yaml.safe_load(written))
    assert found == options
    assert isinstance(found.count, int)


def test_nothing_given_is_the_default():
    assert from_mapping(Example, {}) == Example()


@pytest.mark.parametrize("options", [Example(colour=Colour.BLUE), FitOptions(kind="solid"), PlanOptions()])
def test_options_come_back_from_their_mapping(options):
    mapping = to_mapping(options)
    assert from_mapping(type(options), mapping) == options
    assert all(isinstance(value, bool | int | float | str | tuple) for value in mapping.values())


@pytest.mark.parametrize(("name", "near"), [("counts", "count"), ("Share", "share"), ("color", "colour"), ("xyz", "")])
def test_unknown_name_suggests_the_nearest_and_lists_all(name, near):
    with pytest.raises(OptionsError, match=f"unknown option '{name}'; did you mean '{near}.*count, share, colour"):
        from_mapping(Example, {name: 1})


@pytest.mark.parametrize("key", [5, None])
def test_a_key_that_is_no_text_is_an_unknown_name(key):
    with pytest.raises(OptionsError, match=f"unknown option {key}; .*There are count, share, colour"):
        from_mapping(Example, {key: 1})


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"count": 0}, r"count must be in 1 \.\. 10, got 0"),
        ({"count": 11}, r"count must be in 1 \.\. 10, got 11"),
        ({"share": 1.0001}, r"share must be in 0 \.\. 1, got 1.0001"),
        ({"share": float("nan")}, "share must be in"),
        ({"count": 2.5}, "count must be of type int, got 2.5"),
        ({"count": "3.5"}, "count must be of type int, got '3.5'"),
        ({"count": float("inf")}, "count must be of type int, got inf"),
        ({"share": 10**400}, "share must be of type float, got 1000"),
        ({"loud": "yes"}, "loud must be of type bool, got 'yes'"),
        ({"count": True}, "count must be of type int, got True"),
        ({"share": "much"}, "share must be of type float"),
        ({"share": None}, "share must be of type float, got None"),
        ({"loud": 1}, "loud must be of type bool, got 1"),
        ({"colour": "green"}, "colour must be one of red, blue, got 'green'"),
        ({"colour": 3}, "colour must be one of red, blue"),
        ({"corner_m": [1, 2]}, r"corner_m must be 3 numbers, got \[1, 2\]"),
        ({"corner_m": 1.0}, "corner_m must be 3 numbers, got 1.0"),
        ({"corner_m": [0, 0, 5.1]}, r"corner_m must be in -5 \.\. 5, got \(0.0, 0.0, 5.1\)"),
        ({"corner_m": [float("nan"), 0, 0]}, "corner_m must be in -5"),
        ({"corner_m": [1, "a", 2]}, r"corner_m\[1\] must be of type float, got 'a'"),
    ],
)
def test_wrong_values_are_refused(values, text):
    with pytest.raises(OptionsError, match=text):
        from_mapping(Example, values)


def test_ends_of_a_range_are_allowed():
    for values in ({"count": 1}, {"count": 10}, {"share": 0}, {"share": 1}):
        from_mapping(Example, values)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_corners_must_be_finite(value):
    with pytest.raises(OptionsError, match="low_m"):
        PlanOptions(low_m=(value, 0.0, 0.0))


def test_validation_also_guards_the_constructor():
    with pytest.raises(OptionsError, match="generations must be in 1"):
        FitOptions(generations=0)
    with pytest.raises(OptionsError, match="population must be 0 or in 2"):
        FitOptions(population=1)
