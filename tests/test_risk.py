"""Risk measures against their definitions."""

import jax
import numpy as np
import pytest

from coopmm_jax.errors import UserError
from tuning.cost import risk
from tuning.cost.risk import tail_shares, weighted
from tuning.studies import comparison

COSTS = np.random.default_rng(3).lognormal(size=37)


def test_mean_and_worst():
    assert float(risk.risk("mean")(COSTS)) == pytest.approx(COSTS.mean(), rel=1e-14)
    assert float(risk.risk("worst")(COSTS)) == COSTS.max()


@pytest.mark.parametrize("level", [0.0, 0.37, 0.9, 0.99])
def test_cvar_is_the_minimum_of_rockafellar_and_uryasev(level):
    """min over v of v + E max(c - v, 0) / (1 - level), which one of the costs attains."""
    candidates = [v + np.maximum(COSTS - v, 0.0).mean() / (1.0 - level) for v in COSTS]
    assert float(risk.risk("cvar", level)(COSTS)) == pytest.approx(min(candidates), rel=1e-13)


def test_soft_worst_lies_between_mean_and_worst_and_tends_to_both():
    values = [float(risk.risk("soft_worst", sharpness=s)(COSTS)) for s in (1e-7, 1.0, 3.0, 1e3)]
    assert values == sorted(values)
    assert values[0] == pytest.approx(COSTS.mean(), rel=1e-6)
    assert values[-1] == pytest.approx(COSTS.max(), rel=1e-3)


@pytest.mark.parametrize("kind", risk.KINDS)
def test_weights_are_the_derivative(kind):
    function = risk.risk(kind, level=0.6)
    value, weights = weighted(function, COSTS)
    moved = [float(function(COSTS + h * np.eye(37)[5])) for h in (1e-6, -1e-6)]
    assert value == float(function(COSTS))
    assert weights[5] == pytest.approx((moved[0] - moved[1]) / 2e-6, abs=1e-8)
    assert weights.sum() == pytest.approx(1.0, rel=1e-13)
    assert np.all(weights >= 0.0)


def test_tail_shares_sum_to_one():
    assert tail_shares(10, 0.85) == pytest.approx([2 / 3, 1 / 3, *[0.0] * 8], abs=1e-12)


def test_weights_work_under_jit():
    assert jax.jit(risk.risk("cvar", 0.5))(COSTS) == risk.risk("cvar", 0.5)(COSTS)


def test_unknown_risk():
    with pytest.raises(UserError, match=r"tuning\.risk: must be mean or cvar"):
        risk.risk("median")


def test_ratio_of_paired_values_is_surer_than_of_unpaired_ones():
    """Halved costs: every resample's ratio is a half, however much the costs differ."""
    change = comparison.ratio(np.stack([COSTS, 0.5 * COSTS]))
    assert change == pytest.approx((COSTS.mean(), 0.5 * COSTS.mean(), 0.5, 0.5), rel=1e-13)
    other = np.random.default_rng(4).permutation(0.5 * COSTS)
    unpaired = comparison.ratio(np.stack([COSTS, other]))
    assert unpaired.low < 0.45
    assert unpaired.high > 0.55
