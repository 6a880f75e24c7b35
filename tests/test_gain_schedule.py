"""Gains that change over time or along the path: between knots, in the control law, in files, tuned, compared."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import tuning
from coopmm_jax.control import motion
from coopmm_jax.control.gain_schedule import in_force, rate
from coopmm_jax.control.reference import phase
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.paths import Chebyshev
from coopmm_jax.kinds.timings import Rate, RestToRest
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.start import initial_state
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.partitioning import partition
from coopmm_jax.parameters import Gains, Parameters, PathReference, PhaseSchedule, Reference, Schedule, Structure
from coopmm_jax.scenario.feasible import check_reference
from coopmm_jax.scenario.gains_file import gains_text, read_gains
from coopmm_jax.scenario.scenario import load_scenario
from tests import beside_a_path, closed_costs
from tuning.cost.gain_space import gain_space
from tuning.reports import tune as report
from tuning.reports import tune_figures
from tuning.search.stages import Place, Scan
from tuning.studies import compare

TIMES = (0.5, 1.0, 4.0)
KNOTS = {
    "k2": (5.0, 9.0, 2.0),
    "K_a": (2.0, 1.0, 3.0),
    "K_u": (1.0, 4.0, 2.0),
    "K_I": ((1.0,) * 4, (2.0,) * 4, (0.5,) * 4),
}
RAMP = Schedule(TIMES, KNOTS)
PHASES = (0.5, 2.0, 4.4)  # with a start of the phase at a knot, where slopes change, and knots amid the turn
ROUND = PhaseSchedule(PHASES, KNOTS)


@pytest.fixture
def rollouts(monkeypatch):
    return closed_costs.replace_rollouts(monkeypatch)


@pytest.mark.parametrize("t", [0.0, 0.5, 0.7, 1.0, 2.2, 4.0, 30.0])
def test_gains_between_knots(t):
    found = in_force(Parameters(schedule=RAMP), t)
    assert float(found.k2) == pytest.approx(np.interp(t, TIMES, KNOTS["k2"]), rel=1e-14)
    np.testing.assert_allclose(found.K_I, [np.interp(t, TIMES, [1.0, 2.0, 0.5])] * 4, rtol=1e-14)
    assert found.k1 == Gains().k1


def test_rates_of_gains():
    model = Parameters(schedule=RAMP)
    assert float(rate("k2", model, 0.7)) == pytest.approx(8.0, rel=1e-14)
    assert [float(rate("k2", model, t)) for t in (0.2, 5.0)] == [0.0, 0.0]
    assert rate("k1", model, 0.7) is None


BACKWARDS = PathReference(beside_a_path.ELLIPSE, Rate(rate=-1.5, start=PHASES[0], sway=0.2))


@pytest.mark.parametrize("reference", [Reference(rate=2.0), BACKWARDS], ids=["circles", "ellipse"])
@pytest.mark.parametrize("t", [0.0, 0.4, 1.3, 3.0, 20.0])
def test_gains_repeat_themselves_round_a_closed_path(reference, t):
    """Against numpy's interpolation with a period; at their rate by differences."""
    model = Parameters(reference=reference, schedule=ROUND)
    h = 1e-6

    def expected(t):
        return np.interp(float(phase(reference, t)), PHASES, KNOTS["k2"], period=2.0 * np.pi)

    assert float(in_force(model, t).k2) == pytest.approx(expected(t), rel=1e-12)
    np.testing.assert_allclose(in_force(model, t).K_I, [float(in_force(model, t).K_I[0])] * 4, rtol=1e-14)
    slope = (expected(t + h) - expected(t - h)) / (2.0 * h)
    assert float(rate("k2", model, t)) == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_gains_along_an_open_path_are_constant_beyond_its_knots():
    line = PathReference(Chebyshev(), RestToRest(duration=4.0))
    model = Parameters(reference=line, schedule=PhaseSchedule((-0.5, 0.5), {"k2": (3.0, 5.0)}))
    found = [float(in_force(model, t).k2) for t in (0.0, 2.0, 4.0, 9.0)]
    assert found == pytest.approx([3.0, 4.0, 5.0, 5.0], rel=1e-14)
    assert float(rate("k2", model, 2.0)) == pytest.approx(2.0 * 2.1875 * 2.0 / 4.0, rel=1e-12)  # of smooth_rise: 35/16


def _nu(model, part, t, state):
    """z - K_u I (n,), whose rate the law feeds forward."""
    z = np.array(motion.reference_velocities(model, part, t, state.position, state.controller.eta))
    integral = np.zeros_like(z)
    integral[[2, 5]] = state.controller.integral
    return z - float(in_force(model, t).K_u) * integral


@pytest.mark.parametrize(
    "parameters",
    [
        Parameters(schedule=RAMP),
        Parameters(schedule=ROUND),
        beside_a_path.ellipse()._replace(schedule=ROUND),
    ],
    ids=["over time", "on circles", "round an ellipse"],
)
def test_the_rate_of_nu_knows_that_gains_change(parameters):
    """Along the flow, by differences; without the gains' own rates it is far off."""
    structure, t, h = Structure(), 0.7, 1e-5
    model = build_model(parameters)
    part = partition(structure.rows)
    state = initial_state(structure, model, parameters).state
    rng = np.random.default_rng(3)
    state = jax.tree.map(lambda x: x + 0.05 * rng.normal(), state)
    rates, _ = closed_loop(structure, model, t, state)
    ahead, behind = (
        _nu(model, part, t + s * h, jax.tree.map(lambda x, v, s=s: x + s * h * v, state, rates)) for s in (1, -1)
    )

    def law(model):
        at = (np.asarray(t), state.position, state.controller.eta)
        z, z_rate = motion.reference_and_rate(model, part, at, rates.position, rates.controller.eta)
        gains = in_force(model, t)
        errors = (gains, part, z, z_rate, state.velocity, state.controller.integral)
        return np.array(motion.motion_errors(*errors, rate("K_u", model, t)).nu_rate)

    frozen = model._replace(gains=in_force(model, t), schedule=None)
    expected = (ahead - behind) / (2.0 * h)
    np.testing.assert_allclose(law(model), expected, rtol=1e-7, atol=1e-7)
    assert np.abs(law(frozen) - expected).max() > 0.1


def test_equal_knots_are_constant_gains():
    structure, constant = Structure(), Schedule(TIMES, {"k2": (5.0,) * 3, "K_sigma": ((0.5,) * 6,) * 3})
    state = initial_state(structure, build_model(Parameters()), Parameters()).state
    with_and_without = [
        jax.tree.leaves(closed_loop(structure, build_model(Parameters(schedule=schedule)), 0.7, state))
        for schedule in (constant, None)
    ]
    np.testing.assert_allclose(*with_and_without, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"times": [0.0, 0.0], "k2": [1.0, 2.0]}, "schedule.times: must be at least two times, each later"),
        ({"k2": [1.0, 2.0]}, "schedule.times: must be given with a schedule of gains"),
        ({"times": [0.0, 1.0]}, "schedule.times: must be given with a schedule of gains, was alone"),
        ({"times": [0.0, 1.0], "k2": [1.0]}, "schedule.k2: must be a list of 2"),
        ({"times": [0.0, 1.0], "K_I": [1.0, [2.0, 3.0]]}, r"schedule.K_I\.2: must be one number or a list of 4"),
        ({"times": [0.0, 1.0], "K_I": [1.0, -2.0]}, r"schedule.K_I\.2: must be at least 0, was -2"),
        ({"times": [0.0, 1.0], "c_hat0": [1.0, 2.0]}, "schedule.c_hat0: must be a field of"),
        ({"phases": [0.0, 1.0]}, "schedule.phases: must be given with a schedule of gains, was alone"),
        ({"phases": [1.0], "k2": [1.0]}, "schedule.phases: must be at least two phases, each higher"),
        ({"phases": [0.0, 1.0, 7.0], "k2": [1.0, 2.0, 3.0]}, "schedule.phases: must be within one turn of 2 pi"),
        ({"times": [0.0, 1.0], "phases": [0.0, 1.0], "k2": [1.0, 2.0]}, "schedule.phases: must be left out where"),
    ],
)
def test_schedules_that_cannot_be(table, message):
    with pytest.raises(UserError, match=message):
        load_scenario("paper", schedule=table)


def test_a_gains_file_holds_its_schedule_and_drops_the_scenarios(tmp_path):
    path = tmp_path / "gains.toml"
    other = load_scenario("paper", schedule={"times": [0.0, 1.0], "k3": [1.0, 2.0]})
    for schedule in (RAMP, ROUND):
        path.write_text(gains_text(Gains(), schedule))
        found = other.with_overrides(read_gains(path)).parameters().schedule
        assert (type(found), found) == (type(schedule), schedule)
    path.write_text(gains_text(Gains()))
    assert other.with_overrides(read_gains(path)).parameters().schedule is None
    assert load_scenario("paper", schedule={"times": [0.0, 1.0], "k3": [1.0, 2.0]}) == other


def test_nineteen_gains_become_152_numbers():
    scenario = load_scenario("sensed", tuning={"schedule": 8})
    space = gain_space(scenario)
    assert (space.size, space.knots, len(space.low)) == (152, 8, 152)
    assert space.labels()[19 + 12] == "K_lambda[1]@t=2.85714"
    at_start = space.applied(scenario.parameters(), space.start)
    np.testing.assert_allclose(at_start.schedule.values["K_lambda"], np.full((8, 4), 0.3), rtol=1e-13)
    moved = space.start + np.arange(152.0) / 100.0
    found = space.applied(scenario.parameters(), moved)
    np.testing.assert_allclose(found.schedule.values["K_I"][7], 1.5 * np.exp(moved[-4:] - space.start[-4:]), rtol=1e-13)
    np.testing.assert_allclose(found.gains.K_sigma, 0.5 * np.exp(np.arange(6.0) / 100.0), rtol=1e-13)


def test_a_scenario_with_a_schedule_is_tuned_at_its_knots():
    table = {"times": [0.0, 3.0], "K_I": [1.0, 2.0], "k2": [5.0, 6.0]}
    scenario = load_scenario("paper", schedule=table, tuning={"gains": ["K_I", "K_a"], "channels": "shared"})
    space = gain_space(scenario)
    np.testing.assert_allclose(space.values(space.start), [1.0, 2.0, 2.0, 2.0], rtol=1e-13)
    found = space.applied(scenario.parameters(), space.start).schedule
    assert found.values["k2"] == (5.0, 6.0)  # not tuned, kept
    with pytest.raises(UserError, match=r"tuning\.schedule: must be left out, or 2"):
        gain_space(scenario.with_overrides({"tuning.schedule": 3}))
    with pytest.raises(UserError, match=r"tuning\.gains: must be without c_hat0"):
        gain_space(load_scenario("paper", tuning={"gains": ["c_hat0"], "schedule": 3}))


def test_slopes_by_knots_are_those_of_interpolation():
    """By the tuned logarithms, of gains two fifths of the way from the second knot to the third."""
    table = {"times": [0.0, 0.03, 0.08], "k2": [5.0, 8.0, 6.0]}
    names = ["K_sigma", "K_lambda", "k2", "K_u"]
    scenario = load_scenario("sensed", schedule=table, tuning={"gains": names, "channels": "shared"})
    space = gain_space(scenario)
    assert space.labels()[2] == "k2@t=0"

    @jax.jit
    def between(vector):
        found = in_force(space.applied(scenario.parameters(), vector), 0.05)
        return jnp.stack([found.K_sigma[5], found.K_lambda[3], found.k2, found.K_u])

    expected = np.einsum("k,ki,ij->ikj", [0.0, 0.6, 0.4], np.exp(space.start).reshape(3, 4), np.eye(4))
    np.testing.assert_allclose(jax.jacfwd(between)(space.start), expected.reshape(4, 12), rtol=1e-14)


def test_knots_go_once_round_or_along_an_open_path():
    over = {"tuning.schedule": 4, "tuning.schedule_over": "phase"}
    circles = gain_space(load_scenario("sensed", **over))
    np.testing.assert_allclose(circles.places, [0.0, np.pi / 2, np.pi, 1.5 * np.pi], rtol=1e-15)
    assert circles.labels()[19 + 12] == "K_lambda[1]@p=1.5708"
    assert isinstance(circles.schedule(circles.start), PhaseSchedule)
    line = load_scenario("paper", **{"reference.path": {"kind": "open"}} | over)
    assert gain_space(line).places == pytest.approx([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0], rel=1e-14)


def test_gains_cannot_go_by_a_phase_that_stands_still():
    still = {"reference.rate": 0.0}
    with pytest.raises(UserError, match=r"^tuning\.schedule_over: must be left out where .* stands still, was a phase"):
        gain_space(load_scenario("paper", **still, **{"tuning.schedule": 3, "tuning.schedule_over": "phase"}))
    with pytest.raises(UserError, match=r"^schedule\.phases: must be left out where the desired motion stands still"):
        check_reference(load_scenario("paper", schedule={"phases": [0.0, 1.0], "k2": [5.0, 6.0]}, **still))
    own = load_scenario("paper", schedule={"times": [0.0, 1.0], "k2": [5.0, 6.0]}, tuning={"schedule_over": "phase"})
    with pytest.raises(UserError, match=r"^tuning\.schedule_over: must be time where the scenario has schedule\.times"):
        gain_space(own)


def test_a_scan_moves_all_knots_of_a_gain_and_keeps_their_shape():
    class Far:
        low, high = np.full(4, -3.0), np.full(4, 3.0)

        def values(self, vectors, count, draw, precision="float64"):
            return np.sum((vectors[:, 1::2] - [1.5, 2.5]) ** 2, axis=1)

    scan = Scan(seed=1, knots=2)
    place = Place(np.array([0.0, -0.5, 0.0, 0.5]), 0, 0, 7, ())
    for _ in range(2):
        place = scan.advance(place, Far()).place
    assert scan.ended(place, 0)
    np.testing.assert_array_equal(place.vector, [0.0, 1.5, 0.0, 2.5])


def test_tuning_writes_a_schedule_that_can_be_used(rollouts, tmp_path):
    scenario = closed_costs.scenario(schedule=3, budget=40.0)
    result = tuning.tune(scenario, out=tmp_path)
    before, after = result.comparison.costs.mean(axis=1)
    assert after < 0.3 * before
    assert len(result.after) == 3 * 19
    assert len(result.margins) == 19
    found = scenario.with_overrides(read_gains(tmp_path / "gains.toml")).parameters()
    assert found.schedule == result.schedule
    np.testing.assert_allclose(found.schedule.values["K_I"][2], result.after[-4:], rtol=1e-12)
    assert "K_I[3]@t=20" in report.table(result)
    report.write_report(tmp_path, result)


def test_tuning_over_the_phase_writes_a_schedule_over_the_phase(rollouts, tmp_path):
    scenario = closed_costs.scenario(schedule=3, schedule_over="phase", budget=2.0)
    result = tuning.tune(scenario, out=tmp_path)
    found = scenario.with_overrides(read_gains(tmp_path / "gains.toml")).parameters().schedule
    assert (type(found), found) == (PhaseSchedule, result.schedule)
    assert "K_I[3]@p=4.18879" in report.table(result)
    figure = tune_figures.gains(result)
    figure.draw_without_rendering()
    assert figure.axes[-1].get_xlabel() == "phase of the path"


OTHER = {"k3": (1.0, 2.0)}


@pytest.mark.parametrize("pair", [(RAMP, Schedule((0.0, 9.0), OTHER)), (ROUND, PhaseSchedule((0.0, 3.0), OTHER))])
def test_gains_with_and_without_a_schedule_are_compared_as_one_program(pair):
    sets = [Parameters(), *(Parameters(schedule=schedule) for schedule in pair)]
    for t in (0.0, 0.8, 3.0, 20.0):
        for own, (gains, schedule) in zip(sets, compare.alike(sets), strict=True):
            expected = jax.tree.leaves(in_force(own, t))
            found = jax.tree.leaves(in_force(Parameters(gains=gains, schedule=schedule), t))
            np.testing.assert_allclose(found, expected, rtol=1e-14)
    structures = {str(jax.tree.structure(each)) for each in compare.alike(sets)}
    assert len(structures) == 1
