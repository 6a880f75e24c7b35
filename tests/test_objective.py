"""The objective on real rollouts: gradients of every tunable gain, and independent batch elements."""

import numpy as np
import pytest

from coopmm_jax.parameters import Gains
from tests import tuning_results
from tuning.cost.objective import TERMS


@pytest.fixture(scope="module")
def results():
    return tuning_results.results()


def test_every_tunable_gain_is_there_and_matters(results):
    assert results["names"] == [name for name in Gains._fields if name != "k4"]
    moving = np.any(np.array(results["gradient"]) != 0.0, axis=0)
    assert moving.all()


def test_every_term_is_there(results):
    terms = np.array(results["terms"])
    assert terms.shape == (4, len(TERMS))
    assert np.all(terms.max(axis=0) > 0.0)


def test_gradient_is_that_of_central_differences(results):
    gradient, central = np.array(results["gradient"]), np.array(results["central"])
    np.testing.assert_allclose(gradient.mean(axis=0), central.mean(axis=0), rtol=2e-7)


def test_a_lane_has_the_same_bits_alone_and_among_others(results):
    assert results["alone"] == results["among"]


def test_float32_has_the_terms_of_float64_to_a_thousandth(results):
    np.testing.assert_allclose(results["single"], results["terms"], rtol=1e-3, atol=1e-9)


def test_gradients_are_of_the_cost_that_terms_add_up_to(results):
    of_gradients, of_terms = results["costs"]
    np.testing.assert_allclose(of_gradients, of_terms, rtol=3e-15)
