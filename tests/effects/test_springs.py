"""Springs that are not linear, against the law of one spring."""

import numpy as np
import pytest

from egophys_core.kinds import node_masses
from egophys_core.simulation import batch_of_models, rollout
from tests.effects.situations import DT, adapted, lifted, relative_forces, run, sheet, solid, with_effect
from tests.reference.effects import spring_law
from tests.simulation.scenes import FAR_BELOW, frame_times, idle_controls


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("strain_stiffening", {"coefficient": 200.0}),
        ("tension_compression_asymmetry", {"change": 0.5}),
        ("viscoelasticity", {"ratio": 2.0, "time": 0.04}),
        ("plasticity", {"flow": 5.0, "yield_strain": 0.02}),
        ("hysteresis", {"strength": 1.5, "strain": 0.02}),
    ],
)
def test_a_law_does_what_its_reference_does(name, values):
    strains = 0.1 * np.sin(np.linspace(0.3, 9.0, 600)) + 0.03 * np.sin(np.linspace(0.0, 40.0, 600))
    law, exact = spring_law(name, values), []
    for strain in strains:
        factor, shift = law(np.array([strain]), DT)
        exact.append(float(factor[0] * (strain - shift[0])))
    assert relative_forces(name, values, strains) == pytest.approx(np.array(exact), abs=6e-5)


@pytest.mark.parametrize("strain", [-0.1, 0.0, 0.05, 0.1])
def test_strain_stiffening_follows_its_law(strain):
    found = relative_forces("strain_stiffening", {"coefficient": 200.0}, [strain])[0]
    assert found == pytest.approx(strain + 200.0 * max(strain, 0.0) ** 3, abs=1e-6)


def test_a_stretched_viscoelastic_spring_relaxes_exponentially_and_forgets():
    # F(t) / (k l0) = e (1 + ratio exp(-t / time)).
    found = relative_forces("viscoelasticity", {"ratio": 2.0, "time": 0.1}, [0.1] * 100 + [0.0] * 400)
    assert found[:100] == pytest.approx(0.1 * (1 + 2.0 * np.exp(-np.arange(100) * DT / 0.1)), abs=1e-6)
    assert found[100] < -0.1
    assert abs(found[-1]) < 1e-3


def test_plastic_strain_relaxes_to_the_yield_strain_and_stays():
    # e - p falls to the yield strain by exp(-flow t).
    found = relative_forces("plasticity", {"flow": 50.0, "yield_strain": 0.02}, [0.1] * 300 + [0.07] * 30)
    assert found[:300] == pytest.approx(0.02 + 0.08 * np.exp(-50.0 * DT * np.arange(300)), abs=1e-6)
    assert found[300:] == pytest.approx(-0.01, abs=1e-5)


@pytest.mark.parametrize("steps", [40, 400])
def test_bouc_wen_loading_is_an_exponential_at_any_speed(steps):
    # z = 1 - exp(-e / scale) from rest.
    strains = np.linspace(0.0, 0.1, steps + 1)
    found = relative_forces("hysteresis", {"strength": 1.5, "strain": 0.04}, strains)
    step = 0.1 / steps / 0.04
    exact = strains + 1.5 * 0.04 * (1 - np.exp(-strains / 0.04))
    # Within a step it is elastic, which is ahead by a share of the step.
    assert found == pytest.approx(exact, abs=1.5 * 0.04 * step)


def test_a_cycle_of_bouc_wen_takes_energy_and_closes():
    turns = 0.1 * np.sin(np.linspace(0, 6 * np.pi, 601))
    found = relative_forces("hysteresis", {"strength": 1.0, "strain": 0.02}, turns)
    work = [float(np.trapz(found[at : at + 201], turns[at : at + 201])) for at in (200, 400)]
    # Between two springs that slip at +- strength * strain, less what the turns round off.
    assert work[0] == pytest.approx(work[1], rel=1e-3)
    assert 0.5 < work[0] / (4 * 0.02 * 0.1) < 1.0


DISSIPATIVE = [
    ("quadratic_drag", {"coefficient": 20.0}),
    ("viscoelasticity", {"ratio": 5.0, "time": 0.03}),
    ("plasticity", {"flow": 30.0, "yield_strain": 0.01}),
    ("hysteresis", {"strength": 3.0, "strain": 0.02}),
]


def energies(models):
    """[K, F] joules: of nodes that move by their springs alone, as stretched by what a law does not change."""
    times = frame_times(1.0, 1 / 120)
    start = models[0].graph.positions.astype(np.float64) * [1.15, 0.9, 1.0]
    batch = batch_of_models(
        models, [idle_controls(times)] * len(models), starts=[start] * len(models), ground_height=FAR_BELOW
    )
    result = rollout(batch)
    result.raise_on_failure()
    speeds = np.gradient(result.positions.astype(np.float64), times, axis=1)
    return 0.5 * np.einsum("kn,kfnx->kf", batch.masses.astype(np.float64), speeds**2)


def test_a_body_that_dissipates_moves_less_and_less():
    """Kinetic energy of a body that is let go strained: what any window of time has most of is less than before."""
    model = solid(stiffness=20.0, damping=0.0, drag=0.0, gravity=0.0)
    models = [with_effect(model, name, **values) for name, values in DISSIPATIVE]
    found = energies([model, *models])
    peaks = found[:, 1:-1].reshape(len(found), 7, -1).max(axis=2)
    assert (peaks[0] > 0.5 * peaks[0].max()).all()
    for (name, _), each in zip(DISSIPATIVE, peaks[1:], strict=True):
        assert each[-1] < 0.7 * each[0], name
        assert (each[1:] < each[:-1] + 0.005 * each[0]).all(), name


def test_laws_in_one_lane_group_are_what_they_are_alone():
    """To the bit: eight rollouts of which some have one law, one has two and one has none."""
    model = solid(stiffness=20.0, damping=0.01)
    models = [model, *(with_effect(model, name, **values) for name, values in DISSIPATIVE)]
    models.append(with_effect(models[2], "strain_stiffening", coefficient=50.0))
    together = rollout(batch_of_models(models, [lifted()] * len(models), ground_height=0.0))
    for row, each in enumerate(models):
        alone = rollout(batch_of_models([each], [lifted()], ground_height=0.0))
        assert np.array_equal(alone.positions[0], together.positions[row]), each.effects
    assert len({positions.tobytes() for positions in together.positions}) == len(models)


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
    # Springs of 25 Hz and more, whose forces change within a few substeps.
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


def test_added_mass_is_heaviest_at_its_place_and_weighs_its_fraction():
    model = solid()
    added = {"x": 0.05, "y": 0.0, "z": -0.04, "radius": 0.03, "fraction": 0.8}
    plain, changed = adapted(model, "uneven_mass", **{**added, "fraction": 0.0}), adapted(model, "uneven_mass", **added)
    assert changed.masses.sum() == pytest.approx(plain.masses.sum())
    box = plain.rest_positions
    place = (box.min(axis=0) + box.max(axis=0)) / 2 + [0.05, 0.0, -0.04]
    nearest = np.argsort(np.linalg.norm(box - place, axis=1))
    assert (np.diff(changed.masses[nearest]) <= 1e-12).all()
    assert changed.stiffness is plain.stiffness or (changed.stiffness == plain.stiffness).all()


def test_added_mass_far_from_the_object_is_in_its_nearest_node():
    added = {"x": 1.0, "y": 1.0, "z": 0.0, "radius": 0.005, "fraction": 1.0}
    masses = adapted(sheet(), "uneven_mass", **added).masses
    assert np.isfinite(masses).all()
    assert masses.max() == pytest.approx(17 / 16 * masses.sum() / 2, rel=1e-3)
    assert masses.sum() == pytest.approx(node_masses(sheet()).sum())
