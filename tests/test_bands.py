"""Bands over time: quantiles of the rollouts under way, failures, and axes that fit what is drawn."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from coopmm_jax.plotting.bands import band, finished, scale

T = np.linspace(0.0, 1.0, 5)
WITHIN = (0.05, 0.95)


@pytest.fixture
def axes():
    return Figure().subplots()


def edges(area):
    points = area.get_paths()[0].vertices
    return points[:, 1].min(), points[:, 1].max()


def test_band_has_median_quantiles_and_range(axes):
    values = np.arange(101.0)[:, None] * np.ones(5)
    assert band(axes, T, values, WITHIN, {"color": "k"}, {"color": "0.5"}, {"color": "0.9"})
    assert axes.lines[0].get_ydata().tolist() == [50.0] * 5
    whole, most = axes.collections
    assert edges(whole) == (0.0, 100.0)
    assert edges(most) == pytest.approx((5.0, 95.0))


def test_rollouts_count_until_they_fail(axes):
    values = np.array([[1.0] * 5, [3.0, 3.0, np.nan, np.nan, np.nan]])
    assert band(axes, T, values, WITHIN, {})
    assert axes.lines[0].get_ydata().tolist() == [2.0, 2.0, 1.0, 1.0, 1.0]
    assert finished(values).tolist() == [[1.0] * 5]


def test_bands_end_with_the_last_rollout_and_none_is_nothing(axes):
    values = np.array([[1.0, 2.0, np.nan, np.nan, np.nan]])
    assert band(axes, T, values, WITHIN, {})
    assert axes.lines[0].get_xdata().tolist() == T[:2].tolist()
    assert not band(axes, T, values[:, 2:], WITHIN, {})
    assert not band(axes, T, finished(values), WITHIN, {})
    assert len(axes.lines) == 1


@pytest.mark.parametrize(
    ("name", "low", "high", "expected"),
    [
        ("tracking_error", 0.01, 1.0, "log"),
        ("object_error, late", 0.01, 1.0, "log"),
        ("tracking_error", 0.2, 1.0, "linear"),
        ("tracking_error", 0.0, 1.0, "linear"),
        ("contact_force", 0.01, 1.0, "linear"),
    ],
)
def test_errors_over_a_decade_have_logarithmic_axes(axes, name, low, high, expected):
    band(axes, T, np.array([np.linspace(low, high, 5)]), WITHIN, {})
    scale([axes], name, "[m]")
    assert axes.get_yscale() == expected
    assert axes.get_ylabel() == f"{name.replace('_', ' ')} [m]"
