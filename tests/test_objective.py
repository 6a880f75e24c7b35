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


def test_slope_by_knots_of_gains_that_change(results):
    assert len(results["knots"]) == 12
    assert results["knots"][2] == "k2@t=0"
    slope, central = results["along_knots"]
    np.testing.assert_allclose(slope, central, rtol=1e-6)


def test_float32_has_the_terms_of_float64_to_a_thousandth(results):
    np.testing.assert_allclose(results["single"], results["terms"], rtol=1e-3, atol=1e-9)


def test_the_plain_function_is_the_one_that_is_tuned(results):
    plain, tuned = results["plain"]
    np.testing.assert_allclose(plain, tuned, rtol=3e-15)
