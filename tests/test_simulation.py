"""``simulate``: what the arrays hold, how failures end them, and that other numbers compile nothing."""

import json

import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.metrics.table import METRICS, WHOLE
from coopmm_jax.runs import simulation
from coopmm_jax.runs.trajectory import Trajectory

SIZES = {"t": 1001, "row": 4, "independent": 6, "independent_arm": 2}


def arrays(run):
    return {name: getattr(run, name) for name in run.arrays}


def changed(run, **overrides):
    return run.scenario.with_overrides(overrides)


def test_shapes_are_the_documented_ones(simulated_paper):
    labels = simulated_paper.to_xarray().sizes
    for name, about in simulated_paper.arrays.items():
        value = getattr(simulated_paper, name)
        assert value.shape == tuple(SIZES.get(dim, labels[dim]) for dim in about["dims"]), name
        assert value.dtype == np.float64
        assert np.isfinite(value).all()
        assert f"{name} (" in Trajectory.__doc__


def test_state_and_forces_of_the_paper(simulated_paper):
    """model.md section 5, at t = 1 s and at the start."""
    run = simulated_paper
    assert run.t[-1] == 1.0
    position = np.concatenate([run.zeta[-1], run.q[-1, :, 3:]], axis=1)
    expected = [
        [0.993068, 2.405048, -0.023436, 1.232574, -0.794428, 1.588857],
        [0.995697, 1.032931, -0.080464, 1.596680, 2.299786, 1.683614],
    ]
    np.testing.assert_allclose(position, expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(run.constraint_force[-1], [-6.67759, 5.45729, -76.73173, 18.35874], rtol=2e-6)
    np.testing.assert_allclose(run.constraint_force[0], [8.01362, 4.75186, -3.76017, 12.27700], rtol=2e-6)
    np.testing.assert_allclose(run.c_hat[-1], [2.036303, 0.817932, 1.111726, 0.726273, 1.828628], rtol=1e-6)
    np.testing.assert_allclose(run.torque[-1, 0], [16.8394, 2.1743, 1.4629, 0.1992, 1.4369], rtol=0, atol=1e-4)


def test_world_coordinates(simulated_paper):
    """(6) and the arm's geometry, recomputed from the world coordinates."""
    run = simulated_paper
    x, y, th, a1, a2, a3 = np.moveaxis(run.q, -1, 0)
    zeta = np.stack([th, x * np.cos(th) + y * np.sin(th), -x * np.sin(th) + y * np.cos(th)], axis=-1)
    np.testing.assert_allclose(run.zeta, zeta, rtol=0, atol=1e-14)
    reach = 0.5 * np.cos(a2) + 0.5 * np.cos(a2 + a3)
    height = 1.0 + 0.5 * np.sin(a2) + 0.5 * np.sin(a2 + a3)
    tip = np.stack([x - reach * np.sin(th + a1), y + reach * np.cos(th + a1), height], axis=-1)
    np.testing.assert_allclose(run.tip, tip, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(run.contact_point, axis=1), 0.7, rtol=0, atol=1e-11)
    assert np.array_equal(run.arm, a1)


def test_references(simulated_paper):
    run, t = simulated_paper, simulated_paper.t
    assert np.array_equal(t, np.arange(1001) * 1e-3)
    for i, radius in enumerate((2.4, 1.0)):
        np.testing.assert_array_equal(run.zeta_desired[:, i], np.stack([t, 0 * t + radius, 0 * t], axis=1))
    np.testing.assert_allclose(run.arm_desired[:, 0], np.pi / 2 - np.pi / 6 * np.cos(t), rtol=1e-15)
    assert np.all(run.arm_desired[:, 1] == np.pi / 2)
    assert np.all(run.constraint_force_desired == [15.0, 0.0, 0.0, 0.0])


def test_other_numbers_compile_nothing(simulated_paper):
    compiled = simulation._compiled._cache_size()
    other = changed(
        simulated_paper,
        gains={"K_sigma": [0.7, 0.6, 0.5, 0.4, 0.3, 0.2], "K_lambda": 1, "gamma": 0.2},
        plant={"m_p": [6, 4.0], "gravity": 9.8},
        law={"delta_floor": 0.1},
        simulation={"duration": 0.6, "step": 0.002},
    )
    assert cm.simulate(other).t[-1] == 0.6
    assert simulation._compiled._cache_size() == compiled


def test_horizons_of_about_one_length_share_a_plan():
    assert simulation._plan(20_000, 1) == simulation._plan(19_000, 1)
    for steps in (1, 1000, 1023, 1024, 20_000, 123_456):
        for record_every in (1, 7):
            plan = simulation._plan(steps, record_every)
            assert steps + 1 <= plan.segments * plan.length <= max(1.13 * steps, 1024) + 1024 * record_every


def test_room_beyond_the_horizon_cannot_fail(simulated_paper):
    """The compiled rollout goes on for 10 s with the reference running away from robots that stand still."""
    short = cm.simulate(changed(simulated_paper, simulation={"duration": 0.5, "step": 0.01}))
    assert short.ok
    assert len(short.t) == 51


@pytest.mark.parametrize(
    ("overrides", "status", "samples"),
    [
        ({"simulation.step": 0.05}, "SPEED", 7),
        ({"reference.radius": [2.8, 1.0]}, "SINGULAR_CONTACT", 408),
        ({"gains.k1": 1e9}, "SPEED", 0),
    ],
    ids=["blows up", "singular arm", "at once"],
)
def test_failed_runs_end_before_the_failure(simulated_paper, overrides, status, samples):
    scenario = simulated_paper.scenario.with_overrides(overrides)
    run = cm.simulate(scenario)
    assert not run.ok
    assert run.status is cm.Status[status]
    assert len(run.t) == samples
    assert run.status_time == pytest.approx(samples * scenario.simulation.step, rel=1e-12)
    assert all(np.isfinite(value).all() for value in arrays(run).values())
    known = {name for name, metric in METRICS.items() if metric.window == WHOLE} - {"settling_time"}
    assert {name for name, value in run.metrics.items() if np.isfinite(value)} == (known if samples else set())
    assert f"{status} at {run.status_time:g} s" in repr(run)


@pytest.mark.parametrize(
    ("initial", "lacking"),
    [
        ({"x": [9.0, 1.2]}, "arm I 6\\.1 m out of reach, "),
        # Onto the far half of the arc's circle, which is not the object's surface.
        ({"a2": [-2.0, 2.62], "a3": [3.6, 1.05]}, "first guesses of the joints that lead elsewhere, "),
    ],
)
def test_arms_that_cannot_reach(simulated_paper, initial, lacking):
    message = rf"^initial: must be poses .* was {lacking}\(x [29].*, y 0, .* and \(x 1\.2, y 0, .*\)$"
    with pytest.raises(cm.UserError, match=message):
        cm.simulate(changed(simulated_paper, initial=initial))


@pytest.fixture(scope="module")
def every_seventh(simulated_paper):
    return cm.simulate(changed(simulated_paper, simulation={"record_every": 7, "duration": 0.994}))


def test_sparse_recording_keeps_the_same_samples_and_metrics(simulated_paper, every_seventh):
    dense = cm.simulate(changed(simulated_paper, simulation={"duration": 0.994}))
    assert len(every_seventh.t) == 143
    for name, value in arrays(every_seventh).items():
        expected = getattr(dense, name)
        expected = expected[::7] if "t" in dense.arrays[name]["dims"] else expected
        size = np.abs(expected).max(initial=1.0)
        np.testing.assert_allclose(value, expected, rtol=0, atol=1e-14 * size, err_msg=name)
    assert every_seventh.metrics == pytest.approx(dense.metrics, rel=1e-14, abs=0)


def test_failure_between_recorded_samples(every_seventh):
    """Steps 0-407 are good, so the samples recorded at 0, 7, ..., 406 are kept."""
    run = cm.simulate(every_seventh.scenario.with_overrides({"reference.radius": [2.8, 1.0]}))
    assert run.status_time == pytest.approx(0.408)
    assert run.t.tolist() == pytest.approx(np.arange(0, 0.407, 0.007).tolist())


def test_single_precision(simulated_paper):
    single = cm.simulate(simulated_paper.scenario, precision="float32")
    assert single.scenario == changed(simulated_paper, simulation={"precision": "float32"})
    for value in arrays(single).values():
        assert value.dtype == np.float32
        assert np.isfinite(value).all()
    np.testing.assert_allclose(single.q, simulated_paper.q, rtol=0, atol=1e-4)
    np.testing.assert_allclose(single.constraint_force, simulated_paper.constraint_force, rtol=0, atol=0.1)
    assert single.metrics["constraint_residual_max"] < 2e-5


def test_scenario_by_path_and_bad_precision(simulated_paper, tmp_path):
    path = tmp_path / "short.toml"
    path.write_text('base = "paper"\n[simulation]\nduration = 0.01\n', encoding="utf-8")
    by_path = cm.simulate(str(path))
    assert np.array_equal(by_path.q, simulated_paper.q[:11])
    with pytest.raises(cm.UserError, match=r"^simulation.precision: must be 'float64' or 'float32', was \"half\"$"):
        cm.simulate(by_path.scenario, precision="half")


def test_to_xarray(simulated_paper):
    data = simulated_paper.to_xarray()
    assert set(simulated_paper.arrays) == set(map(str, data.data_vars)) | {"t"}
    chosen = data.torque.sel(robot="II", actuator="left_wheel", t=0.5)
    assert chosen == simulated_paper.torque[500, 1, 1]
    assert data.sigma.sel(independent="II_a1_rate")[-1] == simulated_paper.sigma[-1, 5]
    assert data.constraint_force.sel(row="guide_radial")[0] == simulated_paper.constraint_force[0, 2]
    assert data.q.attrs["units"] == "m, m, rad, rad, rad, rad"
    attributes = json.loads(json.dumps(data.attrs))
    assert json.loads(attributes["metrics"]) == simulated_paper.metrics
    assert attributes["scenario"] == simulated_paper.scenario.to_toml()
    assert attributes["status"] == "OK"
    assert "jax" in json.loads(attributes["versions"])


def test_representation(simulated_paper):
    assert repr(simulated_paper) == "<Trajectory: 1001 samples to 1 s, float64, OK>"
    assert simulated_paper.rows[0] == "contact_normal"
