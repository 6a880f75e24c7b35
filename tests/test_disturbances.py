"""Disturbances: how they go over time, how scenarios have one or many of them, noise by seed and stream."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.errors import UserError
from coopmm_jax.kinds import registry
from coopmm_jax.kinds.disturbances import Disturbance, Noise, Pulse, Sine, Step, Table
from coopmm_jax.mechanics.disturbance import disturbing
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import Hardware, Parameters
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.variation import vary
from tests.samples import assert_close

T = np.linspace(-1.0, 5.0, 241)
PULSE = {"kind": "pulse", "name": "gust", "force_x": 10.0, "start": 2.0}
SINE = {"kind": "sine", "wheel": [0.5, 0.0]}


def values(wave):
    return np.asarray(jax.vmap(wave.value)(jnp.asarray(T)))


def loaded(disturbance, **others):
    return load_scenario("paper", disturbance=disturbance, **others)


def edge(t, width):
    x = np.clip(t / width, 0.0, 1.0)
    return x**2 * (3.0 - 2.0 * x)


def test_kinds_over_time():
    assert_close(values(Sine(2.0, 0.4)), np.sin(2.0 * T + 0.4), 1e-14)
    assert_close(values(Step(0.5, 0.2)), edge(T - 0.5, 0.2), 1e-15)
    assert_close(values(Pulse(0.5, 1.0, 0.2)), edge(T - 0.5, 0.2) - edge(T - 1.5, 0.2), 1e-15)
    assert values(Step(0.5, 0.0)).tolist() == np.where(T >= 0.5, 1.0, 0.0).tolist()
    points = ((0.0, 1.0, 1.5, 4.0), (2.0, -1.0, 0.5, 0.25))
    assert_close(values(Table(*points)), np.interp(T, *points), 1e-13)


def test_gradients_of_edges_are_finite():
    slope = jax.grad(lambda pulse, t: pulse.value(t))
    for t in (0.0, 0.5, 0.505, 1.7):
        for pulse in (Pulse(0.5, 1.0, 0.01), Pulse(0.5, 1.0, 0.0)):
            assert all(math.isfinite(x) for x in slope(pulse, t))


def prepared(stream, seed=0.0, kind=None):
    hardware = Hardware(noise_seed=(0.0, seed), noise_stream=stream)
    disturbance = (Disturbance(kind or Noise(0.2, 3.0)), Disturbance(Noise(0.2, 3.0)))
    return build_model(Parameters(disturbance=disturbance, hardware=hardware)).disturbance


def test_noise_has_its_band_and_its_mean_square():
    wave = prepared(0.0)[0].wave
    frequencies = np.array(wave.frequencies) / (2.0 * math.pi)
    edges = np.linspace(0.2, 3.0, len(frequencies) + 1)
    assert np.all((edges[:-1] <= frequencies) & (frequencies <= edges[1:]))
    long = np.asarray(jax.vmap(wave.value)(jnp.linspace(0.0, 2000.0, 40_001)))
    assert np.mean(long**2) == pytest.approx(1.0, rel=0.02)
    assert abs(np.mean(long)) < 0.01


def test_noise_differs_by_entry_seed_and_stream_and_not_by_batch():
    first, second = prepared(3.0)
    streams = jnp.arange(5.0)
    batch = jax.jit(jax.vmap(lambda stream: jnp.stack(prepared(stream)[0].wave.phases)))(streams)
    alone = np.array(first.wave.phases)
    assert np.array_equal(batch[3], alone)
    for other in (second, prepared(4.0)[0], prepared(3.0, seed=1.0)[0]):
        assert np.all(np.array(other.wave.phases) != alone)


def test_a_table_is_one_entry_and_its_fields_need_no_name():
    scenario = loaded({"scale": 2.0})
    assert scenario.parameters().disturbance == (Disturbance(scale=2.0),)
    assert scenario.with_overrides({"disturbance.phase": 0.3}).parameters().disturbance[0].wave.phase == 0.3
    assert Scenario().parameters().disturbance == (Disturbance(),)
    assert loaded({"kind": "pulse"}).parameters().disturbance == (Disturbance(Pulse(), wheel=None, joint=None),)
    assert loaded([]).parameters().disturbance == ()


def test_a_list_replaces_the_table_and_entries_have_names_and_numbers():
    scenario = loaded([SINE, PULSE])
    sine, gust = scenario.parameters().disturbance
    assert sine == Disturbance(wheel=(0.5, 0.0), joint=0.0)
    assert gust == Disturbance(Pulse(2.0), wheel=None, joint=None, force=(10.0, 0.0, 0.0))
    changed = scenario.with_overrides(
        {"disturbance.gust.start": 3.0, "disturbance.1.scale": 4.0, "disturbance.2.edge": 0}
    )
    assert [each.scale for each in changed.disturbance] == [4.0, 1.0]
    assert changed.parameters().disturbance[1].wave == Pulse(3.0, edge=0.0)
    assert scenario.with_overrides({"disturbance.phase": 1.0}).parameters().disturbance[0].wave.phase == 1.0
    step = scenario.with_overrides({"disturbance.gust.kind": "step"})
    assert step.parameters().disturbance[1] == Disturbance(Step(), wheel=None, joint=None)  # nothing of the pulse stays


@pytest.mark.parametrize("disturbance", [{}, {"kind": "noise", "joint": 1.0}, [SINE, PULSE], []], ids=str)
def test_text_of_a_scenario_loads_as_an_equal_one(disturbance, tmp_path):
    scenario = loaded(disturbance)
    (tmp_path / "s.toml").write_text(scenario.to_toml())
    assert load_scenario(tmp_path / "s.toml") == scenario


def test_any_number_of_an_entry_can_vary():
    law = {"distribution": "uniform", "low": 1.0, "high": 3.0}
    varied = {"disturbance.gust.force_y": law, "disturbance.gust.start": law, "disturbance.1.wheel.2": law}
    scenario = loaded([SINE, PULSE], uncertainty=varied)
    variation = vary(scenario)
    assert [number.name for number in variation.numbers] == list(varied)
    assert [number.unit for number in variation.numbers] == ["N", "s", "N m"]
    sine, gust = variation.batch(np.full((2, 3), 0.25), range(2)).disturbance
    assert np.array_equal(sine.wheel, [[0.5, 0.5], [1.5, 1.5]])
    assert np.array_equal(gust.force, [[10.0, 10.0], [1.5, 1.5], [0.0, 0.0]])
    sample = variation.sample(1, dict.fromkeys(varied, 1.5))
    assert sample.parameters().disturbance[1] == Disturbance(Pulse(1.5), 1.0, None, None, force=(10.0, 1.5, 0.0))


IN_A_LIST = "a table [disturbance], or a list of tables [[disturbance]]"
TABLE = {"kind": "table", "times": [0.0, 1.0]}


@pytest.mark.parametrize(
    ("disturbance", "message"),
    [
        ({"kind": "puls"}, "kind: must be one of sine, step, pulse, noise, table (did you mean pulse?)"),
        ({"kind": 3}, "kind: must be one of sine, step"),
        ({"star": 1.0, "kind": "pulse"}, 'star: must be a field of disturbance "pulse" (did you mean start?)'),
        ([SINE, {"kind": "pulse", "duration": 0.0}], "2.duration: must be greater than 0, was 0"),
        ([SINE, PULSE | {"edge": "x"}], 'gust.edge: must be a number, was "x"'),
        ([PULSE, PULSE], "2.name: must be given to one entry, was gust"),
        ([SINE | {"name": "scale"}], "name: must be unlike the name of a field, was scale"),
        ([SINE | {"name": "1"}], "name: must be letters, digits and _, not a digit first, was 1"),
        ({"kind": "noise", "low": 3.0}, "high: must be greater than low (3), was 2.0"),
        (TABLE | {"values": [1.0]}, "values: must be a list of 2, one for each of times, was a list of 1"),
        (TABLE | {"times": [0, 0], "values": [1, 1]}, "times: must be rising from one to the next"),
        (TABLE, "values: must be given, was missing"),
        ({"gust": {"scale": 1.0}}, "gust: must be a field of [disturbance], or the name or number of an entry"),
    ],
    ids=str,
)
def test_what_cannot_be_is_one_line(disturbance, message):
    with pytest.raises(UserError) as caught:
        loaded(disturbance)
    assert str(caught.value).startswith(f"disturbance.{message}")


@pytest.mark.parametrize("disturbance", [5, [5], "sine"], ids=str)
def test_what_is_no_table_is_one_line(disturbance):
    with pytest.raises(UserError) as caught:
        loaded(disturbance)
    assert str(caught.value).startswith(f"disturbance: must be {IN_A_LIST}, was")


def test_what_cannot_vary_is_one_line():
    for name, message in (
        ("3.scale", "3.scale: must be a field of [disturbance], was unknown"),
        ("gust.sart", "gust.sart: must be a field of [disturbance.gust] (did you mean start?), was unknown"),
        ("gust.name", "gust.name: must be a field whose values are real numbers, was gust"),
        ("gust", "gust: must be a field of [disturbance], was unknown"),
    ):
        with pytest.raises(UserError) as caught:
            loaded(
                [SINE, PULSE], uncertainty={f"disturbance.{name}": {"distribution": "uniform", "low": 1.0, "high": 3.0}}
            )
        assert str(caught.value).startswith(f"uncertainty.disturbance.{message}")


def test_without_disturbances_nothing_acts():
    now = disturbing((), 1.0)
    assert now.torque is None
    assert now.force is None
    assert all(name in registry.known("disturbance") for name in ("sine", "step", "pulse", "noise", "table"))
