"""Checkpoints: what is written is read, and what is wrong is said."""

from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from egophys_core.errors import OutputError, TwinError
from egophys_core.prior import default_codebook, load_codebook, save_codebook
from tests.twin.codebooks import random_codebook


@pytest.fixture
def checkpoint(tmp_path):
    path = tmp_path / "prior.safetensors"
    save_codebook(random_codebook(), path)
    return path


def test_a_codebook_is_read_as_it_was_written(checkpoint):
    assert load_codebook(checkpoint).same_as(random_codebook())


def test_the_default_is_what_the_benchmark_measures():
    measured = Path(__file__).resolve().parents[2] / "benchmarks/prior/checkpoints/codebook_K=4.safetensors"
    assert default_codebook().size == 4
    assert default_codebook().same_as(load_codebook(measured))


def test_a_cut_file_is_refused(checkpoint):
    checkpoint.write_bytes(checkpoint.read_bytes()[:-100])
    with pytest.raises(TwinError, match="no checkpoint, or it is damaged"):
        load_codebook(checkpoint)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(TwinError, match="does not exist"):
        load_codebook(tmp_path / "none.safetensors")


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"format_version": "0"}, "has format 0"),
        ({"features": "[]"}, "train it again"),
    ],
)
def test_another_format_is_refused(checkpoint, header, words):
    good = {"format_version": "1", "features": "[]"}
    save_file(load_file(checkpoint), checkpoint, metadata={**good, **header})
    with pytest.raises(TwinError, match=words):
        load_codebook(checkpoint)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("prototypes", np.zeros((2, 3), np.float32), "head_weights must be"),
        ("prototypes", np.zeros((), np.float32), "prototypes must be"),
        ("surplus", np.zeros(1, np.float32), "unknown arrays"),
        ("hidden_weights", np.full((64, 18), np.inf, np.float32), "not finite"),
    ],
)
def test_wrong_arrays_are_refused(checkpoint, name, value, words):
    from safetensors import safe_open

    with safe_open(checkpoint, framework="numpy") as file:
        header = file.metadata()
    save_file({**load_file(checkpoint), name: value}, checkpoint, metadata=header)
    with pytest.raises(TwinError, match=words):
        load_codebook(checkpoint)


def test_numbers_that_numpy_has_not_are_refused(checkpoint):
    content = checkpoint.read_bytes().replace(b'"F32","shape":[1]', b'"BF16","shape":[2]')
    checkpoint.write_bytes((int.from_bytes(content[:8], "little") + 1).to_bytes(8, "little") + content[8:])
    with pytest.raises(TwinError, match=r"prior\.safetensors is no checkpoint, .*bfloat16"):
        load_codebook(checkpoint)


def test_where_nothing_can_be_written_is_said(tmp_path):
    with pytest.raises(OutputError, match="cannot write checkpoint"):
        save_codebook(random_codebook(), tmp_path / "nowhere/prior.safetensors")
