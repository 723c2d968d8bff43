"""The table of diagnoses that may ask counts what was named right, what was named beside it, and what was invented."""

from benchmarks.asked_table import asked_table


def row(effect, outcome, *named):
    return {
        "effect": effect,
        "size": "large",
        "object": "sheet",
        "planted": None,
        "passive_outcome": "none",
        "passive_named": [],
        "passive_limit": None,
        "motions": [],
        "outcome": outcome,
        "named": list(named),
        "limit": 1.0,
        "track_before_m": 0.01,
        "track_after_m": 0.02,
        "p_null": 0.6,
        "seconds": 1.0,
        "commit": "0000000",
    }


def test_names_beside_the_right_one_are_counted_apart():
    rows = [
        row("quadratic_drag", "named", "quadratic_drag"),
        row("quadratic_drag", "named", "quadratic_drag", "hidden_tether"),
        row("gravity_tilt", "ambiguous", "gravity_tilt", "constant_body_force"),
        row("quadratic_drag", "named_and_ambiguous", "quadratic_drag", "tracking_offset", "gripper_offset"),
        row("grasp_slip", "named", "control_delay"),
        row("none", "unexplained"),
        {**row("none", "named", "added_mass"), "p_null": 0.01},
    ]
    counts = asked_table({"rows": rows}, {}).split("\n\n")[0]
    assert "4 of 5 large ones after asking (0 before)" in counts
    assert "beside it something that was not injected: 2." in counts
    assert "invented in 1 of 2 sets" in counts
    assert "1 said to be unexplained; their p is below 0.05 in 1, below 0.5 in 1 of them" in counts


def test_errors_on_all_motions_that_had_no_part_are_told_of_right_names():
    other = {"motion": "fold", "track_before_m": 0.04, "track_after_m": 0.005}
    rows = [
        {**row("quadratic_drag", "named", "quadratic_drag"), "others": [other]},
        {**row("grasp_slip", "none"), "others": [{**other, "track_before_m": 1.0}]},
    ]
    counts, lines, *_ = asked_table({"rows": rows}, {}).split("\n\n")
    assert "by 20.0, 10.0 mm before and after (sets: 1, errors: 2, geometric mean)" in counts
    assert "10.0, 20.0" in lines
    assert "40.0, 5.0" in lines


def test_errors_beside_the_true_effect_stand_third_where_they_were_measured():
    other = {"motion": "fold", "track_before_m": 0.04, "track_after_m": 0.005}
    compared = {**other, "track_true_m": 0.01}
    right = {**row("quadratic_drag", "named", "quadratic_drag"), "others": [compared], "track_true_m": 0.0025}
    without = {**row("grasp_slip", "named", "grasp_slip"), "others": [{**other, "track_before_m": 1.0}]}
    nothing = {**row("none", "none"), "others": [{**other, "track_true_m": None}], "track_true_m": None}
    counts, lines, *_ = asked_table({"rows": [right, without, nothing]}, {}).split("\n\n")
    assert "beside what was injected, too, it is 20.0, 10.0, 5.0 mm" in counts
    assert "10.0, 20.0, 2.5" in lines


def test_names_are_counted_by_how_far_above_the_stated_limit_an_effect_was_injected():
    named = {**row("quadratic_drag", "named", "quadratic_drag"), "planted": 14.0, "limit": 2.0}
    asked = {**named, "passive_limit": 20.0, "motions": ["swing"]}
    missed = {**row("grasp_slip", "none"), "planted": 0.003, "limit": 0.02}
    never = {**missed, "limit": None}
    counts, *_ = asked_table({"rows": [named, asked, missed, never]}, {}).split("\n\n")
    assert "2 of 2 injected at twice the limit" in counts
    assert "0 of 1 from half of it to twice, 0 of 1 at less" in counts


def test_limits_reached_are_those_of_the_direction_that_shows_least_and_their_medians_over_objects():
    def asked(*sizes):
        limits = [{"effect": "gravity_tilt", "parameter": str(way), "size": size} for way, size in enumerate(sizes)]
        return {**row("none", "none"), "motions": ["swing"], "limits": limits}

    rows = [asked(0.01, 0.05), asked(0.02, 0.03), asked(0.01, None), {**asked(9.0), "motions": []}]
    *_, limits = asked_table({"rows": rows}, {}).split("\n\n")
    (line,) = (each for each in limits.splitlines() if each.startswith("| gravity_tilt "))
    assert "| 0.05 (0.03 to -) |" in line
    assert "sheet (3)" in limits
