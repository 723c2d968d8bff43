"""The codebook of a twin, and the features that it is asked with."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.errors import TwinError
from egophys_core.twin import decode_twin, encode_twin, static_features
from tests.simulation.scenes import sheet_model, sheet_positions
from tests.twin.codebooks import random_codebook
from tests.twin.examples import make_twin


def test_a_twin_keeps_its_codebook():
    twin = make_twin(replace(sheet_model(), codebook=random_codebook()))
    again = decode_twin(encode_twin(twin), name="twin")
    assert again.model.stiffness_model == "codebook"
    assert again.model.codebook.same_as(twin.model.codebook)
    assert again.twin_id == twin.twin_id
    assert encode_twin(again) == encode_twin(twin)


def test_the_codebook_is_part_of_what_a_twin_is():
    ids = {
        make_twin(replace(sheet_model(), codebook=each)).twin_id
        for each in (None, random_codebook(), random_codebook(seed=1))
    }
    assert len(ids) == 3


def test_a_model_says_how_stiff_its_springs_are():
    model = sheet_model()
    uneven = model.stiffness * np.linspace(1.0, 2.0, len(model.stiffness), dtype=np.float32)
    assert model.stiffness_model == "uniform"
    assert replace(model, stiffness=uneven).stiffness_model == "dense"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"low": np.zeros(3, np.float32)}, r"low must be \(18,\), got \(3,\)"),
        ({"prototypes": np.array(1.0, np.float32)}, r"prototypes must be \(2, 0\), got \(\)"),
        ({"head_weights": np.zeros((2, 3, 64), np.float32)}, "head_weights must be"),
        ({"hidden_bias": np.full(64, np.nan, np.float32)}, "hidden_bias is not finite"),
        ({"scale": np.zeros(18, np.float32)}, "scale and temperature must be positive"),
    ],
)
def test_a_codebook_that_cannot_be_is_refused(changes, words):
    with pytest.raises(TwinError, match=words):
        replace(random_codebook(), **changes)


def test_a_twin_file_with_a_damaged_codebook_is_refused():
    twin = make_twin(replace(sheet_model(), codebook=random_codebook()))
    content = encode_twin(twin).replace(b"codebook.low", b"codebook.lov")
    with pytest.raises(TwinError, match="build it again"):
        decode_twin(content, name="twin")


def test_features_of_the_graph_do_not_change_as_the_object_is_moved_and_turned():
    graph = sheet_model(sheet_positions(5)).graph
    turn = Rotation.from_rotvec([0.3, -1.0, 0.7])
    moved = (turn.apply(graph.positions) + [0.4, -0.2, 1.0]).astype(np.float32)
    assert static_features(replace(graph, positions=moved)) == pytest.approx(static_features(graph), abs=2e-3)


def test_a_feature_that_is_not_finite_is_named():
    graph = sheet_model().graph
    lengths = graph.rest_lengths.copy()
    lengths[3] = 1e-40
    with (
        np.errstate(over="ignore"),
        pytest.raises(TwinError, match="feature inverse rest length of spring 3 is not finite"),
    ):
        static_features(replace(graph, rest_lengths=lengths))
