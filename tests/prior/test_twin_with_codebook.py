"""A twin with a codebook is built, planned with and refitted like any other."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, with_effect
from egophys_core.errors import TwinError
from egophys_core.identification import FitOptions, build, evaluate_twin
from egophys_core.identification.options import StiffnessOption
from egophys_core.planning import PlanOptions, grasp_from_points, plan_to_target, twin_costs
from egophys_core.prior import save_codebook
from tests.identification.synthetic import known_model, sheet_episode
from tests.twin.codebooks import plain_codebook, random_codebook
from tests.twin.examples import make_twin

QUICK = {"generations": 1, "population": 4, "frame_stride": 6}


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    path = tmp_path_factory.mktemp("prior") / "prior.safetensors"
    save_codebook(random_codebook(), path)
    return path


def test_a_build_with_the_prior_records_it_and_where_the_object_is_unlike_its_training(checkpoint):
    episode = sheet_episode()
    options = FitOptions(**QUICK, stiffness=StiffnessOption.CODEBOOK, prior=str(checkpoint))
    twin = build([episode], options, seed=0)
    uniform = build([episode], replace(options, stiffness=StiffnessOption.UNIFORM, prior=""), seed=0)
    assert (twin.model.stiffness_model, uniform.model.stiffness_model) == ("codebook", "uniform")
    assert twin.provenance.settings["stiffness"] == "codebook"
    assert any("prior was trained with" in note for note in twin.provenance.settings["assumed"])
    # The same coarse fit, and other motion.
    assert np.array_equal(twin.model.stiffness, uniform.model.stiffness)
    (_, learned), (_, plain) = evaluate_twin(twin, episode), evaluate_twin(uniform, episode)
    assert np.abs(learned - plain).max() > 1e-4


def test_a_wrong_checkpoint_is_refused_before_anything_is_searched(tmp_path):
    def search(stage: str, share: float, loss: float) -> None:
        assert stage == "prepare"

    options = FitOptions(stiffness=StiffnessOption.CODEBOOK, prior=str(tmp_path / "none.safetensors"))
    with pytest.raises(TwinError, match="does not exist"):
        build([sheet_episode()], options, progress=search)


def test_planning_moves_the_twin_as_its_codebook_says():
    options = PlanOptions(waypoints=2, segment_s=0.4, settle_s=0.3, samples=8, iterations=1, noise_m=0.05)
    learned = plain_codebook(prototypes=[[1.2], [1.2]], slope=0.0)
    twins = [make_twin(replace(known_model(), codebook=each), ground_height=0.0) for each in (None, learned)]
    target = twins[0].model.graph.positions + np.float32([0.05, 0.05, 0.05])
    grasp = grasp_from_points(twins[0].grasp)
    plan, _ = plan_to_target(lambda plans: twin_costs(twins[1], plans, target), grasp, options, seed=0)
    costs = [twin_costs(twin, [plan] * 3, target) for twin in twins]
    assert costs[1].tolist() == [plan.predicted_cost] * 3
    assert abs(costs[0][0] - costs[1][0]) > 1e-5


def test_what_a_diagnosis_refits_and_adds_leaves_the_codebook_alone():
    model = replace(known_model(), codebook=random_codebook())
    for each in baseline_parameters(model):
        changed = each.write(model, 0.9 * each.read(model))
        assert changed.codebook is model.codebook
    assert with_effect(model, "gravity_scale", {"scale": 0.8}).codebook is model.codebook
