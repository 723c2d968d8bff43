"""Detection limits in words: from which size, and what these motions cannot show."""

from egophys_core.reporting.limits_section import limits_in_words, limits_table


def limit(effect, parameter, size, unit="1/m", alike=()):
    return {"effect": effect, "parameter": parameter, "unit": unit, "null": 0.0, "size": size, "alike": list(alike)}


def test_of_an_effect_with_directions_the_largest_size_is_said():
    force = [limit("force", axis, size, "m/s^2") for axis, size in (("x", 0.31), ("y", 0.722))]
    assert limits_in_words([limit("drag", "coefficient", 4.0), *force]) == "drag from 4 1/m and force from 0.722 m/s^2"


def test_what_is_not_shown_in_some_direction_is_not_shown():
    limits = [limit("force", "x", 0.3), limit("force", "z", None), limit("gravity", "scale", 0.07, "1")]
    assert limits_in_words(limits) == "gravity from 0.07; in these motions no size shows of force"


def test_of_one_motion_nothing_is_known():
    assert "two motions tell" in limits_in_words([])


def test_every_size_has_a_row_with_what_looks_like_it():
    table = limits_table([limit("drag", "coefficient", 4.0, alike=("gravity", "tilt")), limit("slip", "z", None)])
    assert list(map(list, table.rows)) == [
        ["drag", "coefficient", "4 1/m", "gravity, tilt"],
        ["slip", "z", "in no size", ""],
    ]
