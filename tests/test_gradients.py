"""Gradients through the full 20 s: reverse mode with checkpoints, forward mode and central differences agree."""

import jax
import numpy as np
import pytest

from coopmm_jax.parameters import Structure
from tests import gradient_results


@pytest.fixture(scope="module")
def gradients():
    return {name: np.array(values) for name, values in gradient_results.results().items()}


def test_every_gain_matters(gradients):
    assert gradients["reverse"].shape == (6 + 5 + 4 + 4,)
    assert np.all(gradients["reverse"] != 0)


def test_reverse_and_forward_mode_agree(gradients):
    """Along the direction in which each gain's share of the slope is 1 by reverse mode."""
    assert gradients["forward_share"] == pytest.approx(1.0, abs=5e-14)


def test_gradient_is_that_of_central_differences(gradients):
    np.testing.assert_allclose(gradients["reverse"], gradients["central"], rtol=1e-6)


def test_checkpoints_do_not_change_the_cost(gradients):
    assert gradients["checkpointed_value"] == pytest.approx(gradients["value"], rel=1e-14)


def test_observer_sees_every_sample(gradients, programs):
    """The cost, found on scalars, again from a recorded run on vectors without an observer."""
    run = programs(Structure())(gradient_results.PAPER, gradient_results.STEP, gradient_results.STEPS)
    total = np.sum(jax.vmap(lambda t, s: gradient_results.sample_cost(0.0, t, s))(run.t, run.signals))
    assert gradients["value"] == pytest.approx(float(total), rel=1e-13)


def test_reverse_pass_of_64_rollouts_fits_in_300_megabytes(gradients):
    assert 64 * gradients["reverse_bytes"] < 300e6
