"""The loop with trailers and cars: figures of a study, the proof's (32), slopes, scenario sections, films."""

import random

import jax
import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.animation.skeleton import skeleton
from coopmm_jax.control.polar_motion import polar_aim
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.courses import Sine, Swing
from coopmm_jax.kinds.paths import Circle, Ellipse, bent_frame
from coopmm_jax.kinds.timings import Rate
from coopmm_jax.loop.devices import draw_noise
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.robot_kinematics import placed, steering
from coopmm_jax.parameters import (
    FrontInertia,
    Gains,
    LogPolar,
    Parameters,
    PathReference,
    Pose,
    Rail,
    Structure,
    Trailer,
)
from coopmm_jax.proof.lyapunov import states_of
from coopmm_jax.scenario import feasible
from coopmm_jax.scenario.feasible import check_reference
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.scenario.variation import vary
from tests.samples import rate_of_V1

FULL = Structure(feedforward="full")


def beside_the_circle(away=0.1):
    """Parameters of two trailers that begin ``away`` [m] outside of their circles, the object on a rail."""
    paper, path, timing = Parameters(), Circle(1.7), Rate(ramp=0.5)
    pitch = ((1.097198, -0.795399, 1.590798), (1.570796, 2.346194, 1.590798))
    plant = paper.plant._replace(
        geometry=tuple(g._replace(front=Trailer()) for g in paper.plant.geometry),
        inertia=tuple(i._replace(front=FrontInertia()) for i in paper.plant.inertia),
        guide=Rail(path),
    )
    return paper._replace(
        plant=plant,
        nominal=plant.inertia,
        gains=Gains(k2=3.0, k3=3.0, k4=3.0, delta_floor=0.1),
        reference=PathReference(path, timing, contact=Swing(), contact_force=Sine(15.0, 5.0)),
        start=tuple(Pose(radius + away, 0.0, 0.0, *arm) for radius, arm in zip((2.4, 1.0), pitch, strict=True)),
    )


# z1, z2, z3, a1, a2, a3, z4 of both robots at 1 s
FIGURES = (
    (0.567147, 2.483895, -0.072502, 1.293452, -0.674250, 1.348499, -0.150014),
    (0.565895, 1.082453, -0.074162, 1.572557, 2.234421, 1.814343, -0.132734),
)


def test_run_of_a_study():
    """Figures of a prototype, in which |zetadot| of the robust term is in metres: that moves them by 2e-5."""
    parameters = beside_the_circle()
    run = jax.jit(lambda parameters: rollout(FULL, parameters, 2e-3, 500, Plan.batch(500)))
    state = run(parameters).state
    for geometry, position, figures in zip(build_model(parameters).geometry, state.position, FIGURES, strict=True):
        found = (*placed(geometry, position), geometry.front.unit * position.z4)
        np.testing.assert_allclose([float(x) for x in found], figures, rtol=0, atol=2e-5)


@pytest.fixture(scope="module")
def mixed():
    """Half a second of the shipped scenario, with 0.1 m of offset."""
    return cm.simulate(load_scenario("mixed", simulation={"duration": 0.5}))


def test_a_run_records_the_steering(mixed):
    mixed.check()
    assert mixed.ok
    assert mixed.entries_of("steering") == ["II"]
    car = mixed.scenario.parameters().plant.geometry[1].front
    assert mixed.steering[0, 0] == pytest.approx(np.arctan(car.wheelbase / 1.0), abs=1e-12)  # as the circle asks
    assert np.ptp(mixed.steering) > 1e-4


def test_V1_decays_as_32_says(mixed):
    """The general (32) along a run of both kinds, and the states that it is evaluated at."""
    t, states = states_of(mixed, every=50)
    geometry = build_model(mixed.scenario.parameters()).geometry
    (angle,) = jax.jit(steering)(geometry, states.position)
    np.testing.assert_allclose(angle, mixed.steering[::50, 0], rtol=0, atol=1e-14)
    parameters = mixed.scenario.parameters()
    V1_rate, decay, cross = rate_of_V1(FULL, parameters, t, states)
    np.testing.assert_allclose(V1_rate, cross - decay, rtol=0, atol=1e-11 * np.abs(decay).max())


def test_films_show_the_front_axle(mixed):
    s = skeleton(mixed, np.array([0, 250, 500]))
    assert s.front[0] is None
    ahead = s.front[1].midpoint - s.q[:, 1, :2]
    np.testing.assert_allclose(ahead, 0.8 * s.forward[:, 1], atol=1e-12)
    turn = np.arctan2(
        s.forward[:, 1, 0] * s.front[1].forward[:, 1] - s.forward[:, 1, 1] * s.front[1].forward[:, 0],
        (s.forward[:, 1] * s.front[1].forward).sum(axis=1),
    )
    np.testing.assert_allclose(turn, mixed.steering[[0, 250, 500], 0], atol=1e-12)


def test_noise_reaches_the_front_axle():
    noisy = load_scenario("mixed", sensing={"encoder_noise": 1e-3})
    model = build_model(noisy.parameters())
    first, second = (draw_noise(noisy.structure(), model, sample) for sample in (0, 1))
    assert first.steering[0] is None
    assert first.steering[1] != second.steering[1]
    assert 0.0 < abs(float(first.steering[1])) < 5e-3


@pytest.mark.parametrize(
    ("name", "changes", "complaint"),
    [
        ("paper", {"platform.wheelbase": 0.5}, "platform.wheelbase: must be left out of differential drives, was 0.5"),
        ("paper", {"initial.steer": 0.5}, "initial.steer: must be left out of differential drives, was 0.5"),
        ("trailer", {"initial.steer": 0.0}, "initial.steer: must be to either side, by less than a right angle, was 0"),
        ("trailer", {"platform.l_f": 0.0}, "platform.l_f: must be positive of a trailer"),
        ("trailer", {"platform.kind": "tricycle"}, "platform.kind: must be "),
        ("trailer", {"law.controller": "pid"}, "law.controller: must be one with backstepping (a gain k4)"),
    ],
)
def test_what_does_not_fit_is_one_line(name, changes, complaint):
    with pytest.raises(UserError) as caught:
        load_scenario(name).with_overrides(changes)
    assert str(caught.value).startswith(complaint)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "changes", "complaint"),
    [
        ("trailer", {"platform.wheelbase": 1.2}, "reference.path: must be such that platform II, on two axles"),
        (
            "paper",
            {"platform": {"kind": "car", "wheelbase": 1.2}},
            "reference.radius: must be such that platform II, on",
        ),
        ("ellipse", {"platform.kind": "car"}, "reference.path: must be such that platform II, on two axles"),
        ("eight", {"platform.kind": ["car", "differential"]}, "reference.path: must be such that platform I, on two"),
    ],
)
def test_paths_that_a_front_axle_cannot_follow_are_named(name, changes, complaint):
    with pytest.raises(UserError) as caught:
        check_reference(load_scenario(name).with_overrides(changes))
    assert str(caught.value).startswith(complaint)


def test_turning_radius_of_a_path_has_the_sign_of_its_turns():
    """Radius times yaw rate is the speed along the path, to either side."""
    scenario = load_scenario("eight")
    parameters = scenario.parameters()
    course = feasible._course(parameters.reference, parameters.plant.surface, scenario.simulation.duration)
    speed = course.stretch * np.gradient(course.phase, course.t)
    assert course.turn.min() < 0.0 < course.turn.max()
    steady = (course.t > 2.0) & (course.t < course.t[-1])  # where differences are close to the rate
    np.testing.assert_allclose((course.radius * course.turn)[steady], speed[steady], rtol=1e-4)


def test_lengths_and_masses_vary_and_the_controller_keeps_its_own():
    spread = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
    car = {"kind": ["differential", "car"], "wheelbase": 0.8, "m_f": 1.0}
    varied = {"platform.m_f": spread, "platform.wheelbase": spread}
    scenario = load_scenario("paper_full", platform=car, uncertainty=varied)
    variation = vary(scenario)
    drawn = variation.batch(np.array([[0.75, 0.25]]), [0])
    assert drawn.plant.inertia[0].front is None
    assert drawn.plant.inertia[1].front.m_f == pytest.approx([1.1])
    assert drawn.plant.geometry[1].front.wheelbase == pytest.approx([0.72])
    assert drawn.nominal[1].front.m_f == pytest.approx([1.0])
    alone = variation.sample(0, {"platform.m_f": 1.1, "platform.wheelbase": 0.72})
    assert alone.parameters().plant.inertia[1].front.m_f == 1.1
    assert alone.parameters().nominal[1].front.m_f == 1.0
    lighter = load_scenario("paper_full", platform=car, nominal={"scale": 0.5}).parameters()
    assert lighter.nominal[1].front == FrontInertia(0.5, 0.25, 0.05)


ODD = (
    0,
    1,
    -1.5,
    0.5,
    1e-9,
    1e9,
    1e300,
    float("nan"),
    float("inf"),
    "none",
    "car",
    True,
    [],
    [0.5, 0.7],
    [1.0, "x"],
    {},
)
KINDS = ("differential", "trailer", "car", "tank", "", 3, ["car", "trailer"], ["car"], ["differential", "car"])


def test_odd_sections_are_refused_in_one_line_or_pass():
    draw, refused = random.Random(0), []
    fields = ("wheelbase", "d_f", "l_f", "r_f", "m_f", "I_f", "I_wf", "unit", "colour")
    for _ in range(400):
        table = {"kind": draw.choice(KINDS)} | {draw.choice(fields): draw.choice(ODD) for _ in range(draw.randrange(3))}
        start = {"initial": {"steer": draw.choice(ODD)}} if draw.random() < 0.3 else {}
        try:
            scenario = load_scenario("paper_full", platform=table, **start)
            check_reference(scenario)
            scenario.to_toml()
        except UserError as error:
            refused.append(str(error))
    assert 40 < len(refused) < 360
    assert not any("\n" in line for line in refused)


def test_desired_motion_about_the_origin_meets_the_chained_form():
    """(8) by differentiating each coordinate in time, of a platform beside an ellipse that starts from standstill."""
    aim, rates = jax.jit(lambda t: jax.jvp(lambda t: polar_aim(Ellipse(), Rate(ramp=0.5), 0.7, t), (t,), (1.0,)))(0.7)
    u1, (_, _, z3, z4) = aim.turn[0], aim.zeta
    found = (*rates.zeta, *rates.turn[:3], rates.advance[0])
    np.testing.assert_allclose(found, (u1, u1 * z3, u1 * z4, aim.advance[0], *aim.turn[1:], aim.advance[1]), atol=1e-13)
    x, y = (float(np.exp(aim.zeta[1])) * f(aim.zeta[0]) for f in (np.cos, np.sin))
    beside = cm.load_scenario("ellipse", platform={"kind": "car", "wheelbase": 0.1, "chart": "logpolar"})
    assert beside.parameters().plant.geometry[0].front.chart == LogPolar()
    phase = float(Rate(ramp=0.5).phase(0.7))
    at, _ = bent_frame(Ellipse(), phase)
    np.testing.assert_allclose((x, y), np.array(at.point) + 0.7 * np.array(at.lateral), atol=1e-14)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"platform.unit": 1.0}, "platform.unit: must be left out of the chart logpolar, which has none, was 1"),
        ({"platform.chart": "polar"}, "platform.chart: must be "),
        (
            {"platform.wheelbase": 1.2},
            "reference.path: must be such that platform II, in the chart logpolar, runs round the origin to the left",
        ),
        (
            {"reference.path.x0": 3.0},
            "reference.path: must be such that platform I, in the chart logpolar, runs round the origin to the left",
        ),
    ],
)
def test_what_does_not_fit_the_chart_is_one_line(changes, complaint):
    with pytest.raises(UserError) as caught:
        check_reference(load_scenario("trailer", platform={"chart": "logpolar"}).with_overrides(changes))
    assert str(caught.value).startswith(complaint)


def test_a_list_of_two_wheelbases_varies_as_a_whole_and_in_part():
    law = {"distribution": "uniform", "low": 0.9, "high": 1.1, "relative": True}

    def varied(name):
        scenario = load_scenario("trailer", platform={"wheelbase": [0.8, 0.7]}, uncertainty={name: law})
        return [(number.name, number.base) for number in vary(scenario).numbers if "wheelbase" in number.name]

    both = [("platform.wheelbase.1", 0.8), ("platform.wheelbase.2", 0.7)]
    assert varied("platform.wheelbase") == both
    assert varied("platform.wheelbase.2") == both[1:]
