"""Gains as a vector: bounds, shared and separate entries, start, derivative, messages."""

import jax
import numpy as np
import pytest

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import Gains
from coopmm_jax.scenario.gains_file import read_gains
from coopmm_jax.scenario.scenario import load_scenario
from tuning.cost.gain_space import gain_space

ALL = {"tuning": {"gains": [name for name in Gains._fields if name != "k4"]}, "law": {"delta_floor": 0.1}}


@pytest.mark.parametrize("channels", ["separate", "shared"])
def test_the_start_stands_for_the_scenarios_gains(channels):
    scenario = load_scenario("paper", **ALL | {"tuning": ALL["tuning"] | {"channels": channels}})
    space = gain_space(scenario)
    for name, value in space.gains(space.start)._asdict().items():
        np.testing.assert_allclose(value, getattr(scenario.parameters().gains, name), rtol=1e-13, err_msg=name)
    assert space.size == (14 if channels == "shared" else 6 + 5 + 5 + 4 + 4 + 9)


def test_default_is_the_full_vector_per_channel():
    space = gain_space(load_scenario("paper"))
    assert space.size == 6 + 5 + 4 + 4
    assert space.labels()[:7] == [*(f"K_sigma[{i}]" for i in range(6)), "gamma[0]"]


@pytest.mark.parametrize("far", [-1e3, -30.0, 30.0, 1e3])
def test_what_is_moved_inside_leaves_no_bound(far):
    scenario = load_scenario("paper", **ALL)
    space = gain_space(scenario)
    for value, owner in zip(space.values(space.inside(np.full(space.size, far))), space.owner, strict=True):
        low, high = getattr(scenario.tuning.bounds, space.names[owner])
        assert low * (1 - 1e-12) - 1e-12 <= value <= high * (1 + 1e-12)


def test_K_lambda_may_be_negative_but_stays_above_minus_one():
    bounds = {"gains": ["K_lambda"], "bounds": {"K_lambda": [-0.9, 5.0]}}
    space = gain_space(load_scenario("paper", tuning=bounds))
    assert np.all(np.asarray(space.values(space.inside(np.full(4, -1e3)))) == pytest.approx(-0.9, abs=1e-12))


def test_one_unit_is_a_factor_of_e():
    space = gain_space(load_scenario("paper", tuning={"gains": ["K_a"]}))
    slope = jax.grad(lambda x: jax.numpy.log(space.values(x)[0]))(np.full(1, 0.3))
    assert slope[0] == pytest.approx(1.0, rel=1e-14)


def test_spread_is_alike_within_a_gain_and_logarithmic():
    space = gain_space(load_scenario("paper"))
    values = np.asarray(space.values(space.spread(np.full(4, 0.5))))
    assert values[:6] == pytest.approx(np.sqrt(0.05 * 50.0), rel=1e-13)
    assert values[11:15] == pytest.approx(np.sqrt(31.0) - 1.0, rel=1e-13)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"tuning": {"gains": ["K_lamda"]}},
            r"tuning\.gains: must be some of .* \(did you mean K_lambda\?\), was K_lamda",
        ),
        ({"tuning": {"gains": ["K_I", "K_I"]}}, "tuning.gains: must be different names"),
        ({"tuning": {"weights": {"forces": 1.0}}}, r"weights\.forces: .* \(did you mean force\?\)"),
        ({"tuning": {"bounds": {"K_I": [3.0, 2.0]}}}, r"bounds\.K_I: must be a lower and a higher bound"),
        ({"tuning": {"bounds": {"K_lambda": [-1.0, 2.0]}}}, "greater than -1"),
    ],
)
def test_settings_that_cannot_be(changes, message):
    with pytest.raises(UserError, match=message):
        load_scenario("paper", **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tuning": {"bounds": {"K_I": [2.0, 3.0]}}}, r"tuning\.bounds\.K_I: .* starting gain 1\.5 lies, was"),
        ({"tuning": {"channels": "shared"}, "gains": {"gamma": [1.0, 1, 1, 1, 2]}}, "gains.gamma: must be one number"),
    ],
)
def test_starts_that_cannot_be_tuned(changes, message):
    with pytest.raises(UserError, match=message):
        gain_space(load_scenario("paper", **changes))


@pytest.mark.parametrize(
    ("text", "message"),
    [(None, "can be read"), ("gains = [", "a TOML file"), ("[plant]\nd = 1.0\n", "with plant"), ("", "with nothing")],
)
def test_gains_files_that_cannot_be_used(tmp_path, text, message):
    path = tmp_path / "gains.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UserError, match=message):
        read_gains(path)
