"""Every effect of the library can be planted, by its name and with its parameters."""

import numpy as np
import pytest

from egophys_core.errors import OptionsError
from egophys_core.rehearsal import PLANTS, complete_effects, planted_sizes

LIBRARY = [
    "quadratic_drag",
    "constant_body_force",
    "time_varying_body_force",
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


def test_the_whole_library_can_be_planted():
    assert sorted(PLANTS) == sorted(LIBRARY)


@pytest.mark.parametrize("name", LIBRARY)
def test_sizes_are_complete_and_differ(name):
    sizes = planted_sizes(name)
    assert sizes["small"].keys() == sizes["large"].keys() == PLANTS[name].units.keys()
    assert sizes["small"] != sizes["large"]


def test_parameters_not_given_are_those_of_the_small_size():
    effects = complete_effects({"grasp_slip": {"rate": 0.1}, "gravity_scale": {}})
    assert effects == {
        "grasp_slip": {"rate": 0.1, "onset": PLANTS["grasp_slip"].small["onset"]},
        "gravity_scale": dict(PLANTS["gravity_scale"].small),
    }


def test_changing_a_size_does_not_change_the_next():
    planted_sizes("quadratic_drag")["large"]["c_per_kg"] = 0.0
    assert planted_sizes("quadratic_drag")["large"]["c_per_kg"] > 0.0


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"quadratic_drg": {}}, "unknown effect 'quadratic_drg'; did you mean 'quadratic_drag'?"),
        ({"grasp_slip": {"onse": 1.0}}, "unknown parameter of grasp_slip 'onse'; did you mean 'onset'? There are rate"),
        ({"grasp_slip": {"onset": np.nan}}, "grasp_slip: onset must be a finite number, got nan"),
    ],
)
def test_bad_requests_say_what_is_wrong(effects, message):
    with pytest.raises(OptionsError) as raised:
        complete_effects(effects)
    assert message in str(raised.value)
