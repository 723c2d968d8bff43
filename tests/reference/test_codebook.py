"""The reference itself, on cases worked by hand."""

import numpy as np
import pytest

from tests.reference.codebook import dynamic_of, factors
from tests.twin.codebooks import plain_codebook


def test_a_spring_that_is_stretched_and_pulled_apart():
    positions, velocities = np.array([[0.0, 0, 1], [0.3, 0, 1.4]]), np.array([[0.0, 0, 0], [0.6, 0, 0.8]])
    found = dynamic_of(positions, velocities, np.array([0, 1]), np.array([[0, 1]]), np.array([0.4]), 0.2)
    assert found[0] == pytest.approx([np.log(1.25), 0.25, 2.5, 0.8, 1.0, 1.0])


def test_two_prototypes_are_mixed_by_their_scores():
    # One unit that is the log stretch times 10; scores 10 s and 0, temperature 0.5.
    codebook = plain_codebook(prototypes=[[0.3, -0.1], [0.2, 0.2]], slope=10.0)
    static = np.zeros((2, 12))
    stretch = np.array([[0.05, 0, 0, 0, 0, 0], [-0.05, 0, 0, 0, 0, 0]])
    share = 1.0 / (1.0 + np.exp(-0.5 / 0.5))
    expected = np.exp([0.3 * share - 0.1 * (1.0 - share), 0.2])
    assert factors(codebook, static, stretch) == pytest.approx(expected)


def test_an_offset_is_at_most_a_factor_of_four():
    codebook = plain_codebook(prototypes=[[5.0], [-5.0]], slope=0.0)
    stretch = np.array([[0.05, 0, 0, 0, 0, 0], [-0.05, 0, 0, 0, 0, 0]])
    assert factors(codebook, np.zeros((2, 12)), stretch) == pytest.approx([np.exp(1.4), np.exp(-1.4)])
