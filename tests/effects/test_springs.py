"""Springs that are not linear, against the law of one spring."""

from itertools import pairwise

import numpy as np
import pytest

from egophys_core.effects.hysteresis import followed
from egophys_core.kinds import node_masses
from tests.effects.situations import (
    FRAME,
    adapted,
    lifted,
    loads_of,
    relative_force,
    run,
    sheet,
    solid,
    spring_scene,
    with_effect,
)


def forces(name, values, strains):
    """F / (k l0) at the strains of consecutive frames."""
    loads = loads_of(name, values, [spring_scene(strain) for strain in strains])
    return np.array([relative_force(load, strain) for load, strain in zip(loads, strains, strict=True)])


@pytest.mark.parametrize("strain", [-0.1, 0.0, 0.05, 0.1])
def test_strain_stiffening_follows_its_law(strain):
    found = forces("strain_stiffening", {"coefficient": 200.0}, [strain])[0]
    assert found == pytest.approx(strain + 200.0 * max(strain, 0.0) ** 3, abs=1e-12)


@pytest.mark.parametrize("coefficient", [5.0, 500.0])
def test_a_stiffening_spring_under_load_comes_to_rest(coefficient):
    # e + c e^3 = f, found frame by frame, as a light object finds it that settles within a frame.
    f = 0.3
    exact = next(root.real for root in np.roots([coefficient, 0, 1, -f]) if abs(root.imag) < 1e-9)
    strain, memory = 0.0, []
    for _ in range(12):
        load = loads_of("strain_stiffening", {"coefficient": coefficient}, [spring_scene(strain)])[0]
        strain = f / load.stiffness_factor[0] + load.rest_shift[0] / 0.1
        memory.append(strain)
    assert memory[-2:] == pytest.approx([exact, exact], rel=1e-3)


def test_asymmetry_changes_compression_alone():
    values = {"change": 0.5}
    assert forces("tension_compression_asymmetry", values, [-0.1, 0.1]) == pytest.approx([-0.15, 0.1])


def test_a_stretched_viscoelastic_spring_relaxes_exponentially():
    # F(t) / (k l0) = e (1 + ratio exp(-t / time)), taken in mid-frame.
    frames = np.arange(30)
    found = forces("viscoelasticity", {"ratio": 2.0, "time": 0.4}, [0.1] * 30)
    assert found == pytest.approx(0.1 * (1 + 2.0 * np.exp(-(frames + 0.5) * FRAME / 0.4)))


def test_a_viscoelastic_spring_forgets():
    found = forces("viscoelasticity", {"ratio": 2.0, "time": 0.1}, [0.1] * 30 + [0.0] * 60)
    assert found[30] < -0.1
    assert abs(found[-1]) < 1e-6


def test_plastic_strain_relaxes_to_the_yield_strain_and_stays():
    # e - p falls to the yield strain by exp(-flow t).
    values = {"flow": 5.0, "yield_strain": 0.02}
    found = forces("plasticity", values, [0.1] * 60 + [0.07] * 30)
    assert found[:60] == pytest.approx(0.02 + 0.08 * np.exp(-5.0 * FRAME * np.arange(1, 61)))
    assert found[60:] == pytest.approx(-0.01, abs=1e-5)


def test_below_the_yield_strain_nothing_flows():
    strains = [0.019, -0.019] * 20
    assert forces("plasticity", {"flow": 30.0, "yield_strain": 0.02}, strains) == pytest.approx(strains)


@pytest.mark.parametrize("steps", [4, 400])
def test_bouc_wen_loading_is_an_exponential_at_any_speed(steps):
    # z = 1 - exp(-e / scale) from rest.
    strains = np.linspace(0.0, 0.1, steps + 1)
    found = forces("hysteresis", {"strength": 1.5, "strain": 0.04}, strains)
    assert found == pytest.approx(strains + 1.5 * 0.04 * (1 - np.exp(-strains / 0.04)))


def test_a_cycle_of_bouc_wen_takes_energy_and_closes():
    turns = 0.1 * np.sin(np.linspace(0, 6 * np.pi, 601))
    found = forces("hysteresis", {"strength": 1.0, "strain": 0.02}, turns)
    work = [float(np.trapz(found[begin : end + 1], turns[begin : end + 1])) for begin, end in pairwise((200, 400, 600))]
    # Between two springs that slip at +- strength * strain, less what the turns round off.
    assert work[0] == pytest.approx(work[1], rel=1e-3)
    assert 0.5 < work[0] / (4 * 0.02 * 0.1) < 1.0


def test_bouc_wen_goes_straight_back_to_zero():
    z = followed(np.array([0.6, 0.6, -0.6, 0.6]), np.array([-0.4, -0.6, 0.7, 0.0]))
    assert z == pytest.approx([0.2, 0.0, 1 - np.exp(-0.1), 0.6])


def trembling(model):
    """Metres: how far nodes are, in the end, from going on as in the frame before."""
    positions = run(model, lifted(duration=3.0, height=0.0)).positions[0, -20:].astype(np.float64)
    return np.abs(np.diff(positions, n=2, axis=0)).max()


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("strain_stiffening", {"coefficient": 500.0}),
        ("tension_compression_asymmetry", {"change": 5.0}),
        ("viscoelasticity", {"ratio": 5.0, "time": 0.03}),
        ("plasticity", {"flow": 30.0, "yield_strain": 0.01}),
        ("hysteresis", {"strength": 3.0, "strain": 0.02}),
    ],
)
def test_at_its_largest_an_effect_does_not_feed_an_object_that_is_hardly_damped(name, values):
    # Springs of 25 Hz and more, seen at 30 Hz: a law that holds last frame's force shakes the object to pieces.
    model = solid(stiffness=8.0, damping=0.005, drag=1.0)
    assert trembling(with_effect(model, name, **values)) < 2 * trembling(model)


def test_anisotropy_changes_springs_by_their_direction():
    model = sheet()
    plain = adapted(model, "anisotropy", cosine=0.0, sine=0.0)
    along = np.diff(plain.rest_positions[plain.springs], axis=1)[:, 0]
    x, y = np.ptp(plain.rest_positions, axis=0)[:2]
    along = along if x >= y else along[:, [1, 0, 2]]
    angle = np.arctan2(along[:, 1], along[:, 0])
    found = adapted(model, "anisotropy", cosine=0.3, sine=-0.2).stiffness / plain.stiffness
    assert found == pytest.approx(1 + 0.3 * np.cos(2 * angle) - 0.2 * np.sin(2 * angle))
    assert (adapted(model, "anisotropy", cosine=0.9, sine=0.9).stiffness > 0).all()


def test_bending_damping_is_that_of_bending_springs():
    model = sheet()
    plain, changed = adapted(model, "bending_damping", factor=1.0), adapted(model, "bending_damping", factor=3.0)
    assert plain.bending.any()
    assert changed.damping / plain.damping == pytest.approx(np.where(plain.bending, 3.0, 1.0))


def test_a_lump_is_heaviest_at_its_place_and_weighs_its_fraction():
    model = solid()
    lump = {"x": 0.05, "y": 0.0, "z": -0.04, "radius": 0.03, "fraction": 0.8}
    plain, changed = adapted(model, "uneven_mass", **{**lump, "fraction": 0.0}), adapted(model, "uneven_mass", **lump)
    assert changed.masses.sum() == pytest.approx(plain.masses.sum())
    box = plain.rest_positions
    place = (box.min(axis=0) + box.max(axis=0)) / 2 + [0.05, 0.0, -0.04]
    nearest = np.argsort(np.linalg.norm(box - place, axis=1))
    assert (np.diff(changed.masses[nearest]) <= 1e-12).all()
    assert changed.stiffness is plain.stiffness or (changed.stiffness == plain.stiffness).all()


def test_a_lump_far_from_the_object_is_in_its_nearest_node():
    lump = {"x": 1.0, "y": 1.0, "z": 0.0, "radius": 0.005, "fraction": 1.0}
    masses = adapted(sheet(), "uneven_mass", **lump).masses
    assert np.isfinite(masses).all()
    assert masses.max() == pytest.approx(17 / 16 * masses.sum() / 2, rel=1e-3)
    assert masses.sum() == pytest.approx(node_masses(sheet()).sum())
