"""A model with the prior, and the warning about one that it was not trained for."""

from dataclasses import replace

import numpy as np

from egophys_core.prior import with_prior
from egophys_core.twin import static_features
from tests.simulation.scenes import sheet_model, sheet_positions
from tests.twin.codebooks import random_codebook


def trained_on(model):
    features = static_features(model.graph)
    low, high = random_codebook().low.copy(), random_codebook().high.copy()
    low[:12], high[:12] = features.min(axis=0), features.max(axis=0)
    return replace(random_codebook(), low=low, high=high)


def test_an_object_like_those_of_the_training_set_gets_no_warning():
    model = sheet_model(sheet_positions(5))
    learned, warnings = with_prior(model, trained_on(model))
    assert warnings == ()
    assert learned.stiffness_model == "codebook"
    assert np.array_equal(learned.stiffness, model.stiffness)


def test_a_far_larger_object_is_said_with_the_feature_it_differs_in():
    model = sheet_model(sheet_positions(5))
    codebook = trained_on(model)
    graph = replace(model.graph, rest_lengths=3.0 * model.graph.rest_lengths, positions=3.0 * model.graph.positions)
    _, warnings = with_prior(replace(model, graph=graph), codebook)
    assert any("rest length of" in each and "lie outside" in each for each in warnings)
