"""Torque limits, lag and friction of the actuators, alone and in the loop."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coopmm_jax.loop.devices import limited
from coopmm_jax.mechanics.friction import friction_torque, smooth_sign
from coopmm_jax.parameters import Features, Hardware, Structure
from tests import limits_results
from tests.oracles import hardware

SMOOTH, HARD = (Structure(features=Features(**{form: True})) for form in ("smooth_limits", "torque_limits"))
WIDE = Hardware(wheel_limit=100.0, joint_limit=60.0)
torques = st.floats(-1e300, 1e300)


@settings(deadline=None)  # the first call starts JAX
@given(torque=st.tuples(torques, torques, torques, torques, torques))
def test_no_torque_exceeds_its_limit(torque):
    for structure in (HARD, SMOOTH):
        held = np.array(limited(structure, WIDE, torque))
        assert np.all(np.abs(held) <= [100.0, 100.0, 60.0, 60.0, 60.0])
        assert np.all(held * np.array(torque) >= 0.0)


@pytest.mark.parametrize(("torque", "error"), [(0.0, 0.0), (20.0, 4e-7), (50.0, 5e-4)])
def test_smooth_limit_hardly_touches_small_torques(torque, error):
    right, *_ = limited(SMOOTH, WIDE, (torque,) * 5)
    assert torque * (1.0 - error) <= right <= torque


def test_smooth_limit_is_its_closed_form():
    ratios = np.array([0.3, 0.9, 1.0, 1.1, 3.0, 10.0])
    held = [limited(SMOOTH, WIDE, (100.0 * ratio,) * 5)[0] for ratio in ratios.tolist()]
    np.testing.assert_allclose(held, 100.0 * ratios / (1.0 + ratios**8) ** (1 / 8), rtol=1e-14)


@pytest.mark.parametrize("ratio", [-1e30, -2.0, -1.0, 0.0, 0.5, 1.0, 1e30])
def test_smooth_limit_has_its_own_slope_everywhere(ratio):
    slope = jax.grad(lambda torque: limited(SMOOTH, WIDE, (torque,) * 5)[0])(100.0 * ratio)
    assert slope == pytest.approx((1.0 + ratio**8) ** (-9 / 8), rel=1e-12)


def test_friction_opposes_motion():
    values = Hardware(wheel_viscous=0.2, joint_viscous=0.1, wheel_coulomb=0.5, joint_coulomb=0.3, friction_speed=0.01)
    rates = (3.0, -3.0, 0.0, 2.0, -0.01)
    torque = friction_torque(values, rates)
    np.testing.assert_allclose(torque, hardware.friction_torque(values, np.array(rates)), rtol=0, atol=1e-15)
    fast = 3.0 / np.hypot(3.0, 0.01)
    np.testing.assert_allclose(torque[:3], [0.6 + 0.5 * fast, -0.6 - 0.5 * fast, 0.0], rtol=1e-14)


def test_smooth_sign():
    assert float(smooth_sign(0.0, 0.01)) == 0.0
    assert float(smooth_sign(-0.01, 0.01)) == pytest.approx(-np.sqrt(0.5), rel=1e-15)
    assert float(smooth_sign(1.0, 0.01)) == pytest.approx(1.0, abs=6e-5)


@pytest.fixture(scope="module")
def limited_loops():
    return limits_results.results()


@pytest.mark.parametrize("form", ["hard", "smooth"])
def test_gradients_through_limits_are_those_of_central_differences(limited_loops, form):
    gradient, central = (np.array(limited_loops[form][name]) for name in ("gradient", "central"))
    assert gradient.shape == (4 + 4 + 6 + 1,)
    assert np.all(gradient != 0)
    np.testing.assert_allclose(gradient, central, rtol=5e-5)


def test_limits_are_reached_and_never_passed(limited_loops):
    assert limited_loops["hard"]["largest"] == 1.0
    assert 1.0 - 1e-8 < limited_loops["smooth"]["largest"] <= 1.0


def test_smooth_limits_stand_for_hard_ones(limited_loops):
    assert limited_loops["smooth"]["cost"] == pytest.approx(limited_loops["hard"]["cost"], rel=0.02)
