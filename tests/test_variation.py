"""Variation of a scenario: values, points of the unit cube, parameters of samples, messages."""

import jax
import numpy as np
import pytest
from scipy import stats

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import MASS_NAMES, Features
from coopmm_jax.scenario import sampling
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.scenario.sections.requirements import parse
from coopmm_jax.scenario.variation import vary
from coopmm_jax.sweeps.intervals import success

FACTOR = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
EACH = FACTOR | {"each": True}
OFFSET = {"distribution": "normal", "mean": 0.0, "std": 0.01, "offset": True}
PHASE = {"distribution": "uniform", "low": 0.0, "high": 6.0}


def varied(**fields):
    """``plant__m_p=FACTOR`` makes plant.m_p of the paper vary."""
    entries = {name.replace("__", "."): law for name, law in fields.items()}
    return vary(load_scenario("paper", uncertainty=entries))


LAWS = {
    "uniform": ({"low": 2.0, "high": 5.0}, stats.uniform(2.0, 3.0)),
    "log_uniform": ({"low": 0.1, "high": 10.0}, stats.loguniform(0.1, 10.0)),
    "normal": ({"mean": 5.0, "std": 0.5}, stats.norm(5.0, 0.5)),
    "truncated_normal": ({"mean": 5.0, "std": 2.0, "low": 4.0, "high": 9.0}, stats.truncnorm(-0.5, 2.0, 5.0, 2.0)),
}


@pytest.mark.parametrize("name", LAWS)
def test_distributions_are_scipys(name):
    law, expected = LAWS[name]
    variation = varied(plant__m_p={"distribution": name} | law)
    u = np.linspace(0.001, 0.999, 51)
    np.testing.assert_allclose(variation.values(u[:, None])["plant.m_p"], expected.ppf(u), rtol=1e-13)


@pytest.mark.parametrize("name", LAWS)
def test_the_map_is_differentiable_through_jax(name):
    law, expected = LAWS[name]
    variation = varied(plant__m_p={"distribution": name} | law)

    def mass(u):
        return variation.parameters(u[None]).plant.inertia[0].m_p

    u = 0.3
    np.testing.assert_allclose(mass(jax.numpy.asarray(u)), expected.ppf(u), rtol=1e-13)
    np.testing.assert_allclose(jax.grad(mass)(u), 1.0 / expected.pdf(expected.ppf(u)), rtol=1e-12)


def test_a_factor_scales_both_robots_and_leaves_the_controllers_model_alone():
    parameters = varied(plant__masses=FACTOR).parameters(np.array([0.75]))
    base = load_scenario("paper").parameters()
    for robot, was in zip(parameters.plant.inertia, base.plant.inertia, strict=True):
        masses, before = ([getattr(each, name) for name in MASS_NAMES] for each in (robot, was))
        np.testing.assert_allclose(masses, 1.1 * np.array(before), rtol=1e-15)
    assert parameters.nominal == base.nominal
    assert parameters._replace(plant=base.plant) == base


def test_each_number_has_a_draw_of_its_own():
    variation = varied(plant__masses=EACH)
    assert len(variation.draws) == 2 * len(MASS_NAMES) - 1  # robot I carries no object
    points = np.full((1, 19), 0.5)
    points[0, variation.draws.index("plant.m2.2")] = 0.0
    drawn = variation.batch(points, [0]).plant.inertia
    assert drawn[1].m2[0] == pytest.approx(0.4)
    assert drawn[0].m2[0] == pytest.approx(0.5)


def test_one_robot_alone_and_numbers_of_a_pair():
    variation = varied(plant__m_p__1=FACTOR, initial__x=OFFSET, initial__a1__2=OFFSET, reference__radius__1=FACTOR)
    assert variation.draws == ("plant.m_p.1", "initial.x", "initial.a1.2", "reference.radius.1")
    parameters = variation.parameters(np.array([0.75, stats.norm.cdf(1.0), stats.norm.cdf(-2.0), 0.25]))
    assert [robot.m_p for robot in parameters.plant.inertia] == [pytest.approx(5.5), 5.0]
    assert [pose.x for pose in parameters.start] == pytest.approx([2.51, 1.21], rel=1e-14)
    assert [pose.a1 for pose in parameters.start] == pytest.approx([0.5253, 1.55], rel=1e-14)
    assert parameters.reference.radius == (pytest.approx(2.16), 1.0)


def test_a_group_shares_one_draw():
    group = {"group": "load"}
    variation = varied(plant__m_obj=FACTOR | group, disturbance__phase=PHASE | group, plant__m_p=FACTOR)
    assert variation.draws == ("load", "plant.m_p")
    values = variation.values(np.array([0.25, 0.5]))
    assert values == {"plant.m_obj": pytest.approx(0.45), "disturbance.phase": 1.5, "plant.m_p": 5.0}


def test_the_controllers_model_can_vary_by_itself():
    parameters = varied(nominal__m2=FACTOR, nominal__scale={"distribution": "uniform", "low": 0.7, "high": 0.9})
    drawn = parameters.parameters(np.array([0.75, 0.5]))
    assert [robot.m2 for robot in drawn.nominal] == pytest.approx([0.55, 0.55])
    assert [robot.m3 for robot in drawn.nominal] == pytest.approx([0.4, 0.4])
    assert drawn.plant == load_scenario("paper").parameters().plant


def test_names_units_and_meanings():
    number = varied(plant__I_w__2=FACTOR).numbers[0]
    assert (number.name, number.unit) == ("plant.I_w.2", "kg m^2")
    assert number.meaning == "moment of inertia of one wheel about its axle"


def test_effects_whose_numbers_vary_are_in_force():
    variation = varied(sensing__force_lag={"distribution": "uniform", "low": 0.001, "high": 0.01})
    assert variation.structure().features == Features(force_lag=True)
    assert variation.scenario.structure().features == Features()


@pytest.mark.parametrize("method", sampling.METHODS)
def test_a_point_depends_on_seed_and_index_alone(method):
    points = sampler(method, 7, 5)
    together = points(range(100))
    assert together.shape == (100, 5)
    assert len(np.unique(together)) == 500
    assert np.array_equal(points([60, 3, 99, 3]), together[[60, 3, 99, 3]])
    assert np.array_equal(sampler(method, 7, 5)(range(64, 100)), together[64:])
    assert not np.any(sampler(method, 8, 5)(range(100)) == together)


@pytest.mark.parametrize(("method", "error"), [("independent", 0.05), ("sobol", 0.001)])
def test_points_fill_the_cube_evenly(method, error):
    points = sampler(method, 1, 3)(range(1024))
    assert np.abs(points.mean(0) - 0.5).max() < error
    assert np.abs(np.cov(points.T) - np.eye(3) / 12).max() < error


def test_values_of_a_sample_do_not_depend_on_the_batch():
    laws = [{"distribution": name} | law for name, (law, _) in LAWS.items()]
    variation = varied(**{f"plant__m{i}": law for i, law in zip(("_p", "1", "2", "3"), laws, strict=True)})
    points = sampler("independent", 0, 4)(range(67))
    together = variation.values(points)
    for i in range(67):
        alone = variation.values(points[i : i + 1])
        assert all(alone[name][0] == together[name][i] for name in together)


def test_a_sample_is_a_scenario_with_the_same_parameters():
    entries = {"plant.masses": EACH, "initial.x.1": OFFSET, "nominal.m_p": FACTOR}
    variation = vary(load_scenario("uncertain", uncertainty=entries))
    points = sampler("sobol", 0, len(variation.draws))(range(3))
    batch = variation.batch(points, [10, 11, 12])
    values = {name: float(column[1]) for name, column in variation.values(points).items()}
    sample = variation.sample(11, values)
    assert sample.parameters() == jax.tree.map(lambda leaf: float(leaf[1]), batch)
    assert sample.simulation.stream == 11
    assert sample.uncertainty.entries() == ()


SOFT = {"kind": "profile", "coefficients": [0.8, 0.1, 0.2]}


@pytest.mark.parametrize(
    ("entries", "draws", "drawn"),
    [
        ({"coefficients": FACTOR}, 1, (0.88, 0.11, 0.22)),
        ({"coefficients": EACH}, 3, (0.88, 0.11, 0.22)),
        ({"coefficients.3": FACTOR}, 1, (0.8, 0.1, 0.22)),
    ],
)
def test_numbers_of_a_list_vary_together_or_alone(entries, draws, drawn):
    laws = {f"coupling.surface.{name}": law for name, law in entries.items()}
    laws |= {"plant.masses": {"distribution": "none"}, "disturbance.scale": {"distribution": "none"}}
    variation = vary(load_scenario("flat", **{"coupling.surface": SOFT}, uncertainty=laws))
    assert len(variation.draws) == draws
    point = np.full((1, draws), 0.75)
    sample = variation.sample(0, {name: float(value[0]) for name, value in variation.values(point).items()})
    np.testing.assert_allclose(sample.coupling.surface.coefficients, drawn, rtol=1e-12)
    shape = variation.batch(point, [0]).plant.surface.shape
    np.testing.assert_allclose(np.ravel(shape.coefficients), drawn, rtol=1e-12)


def test_a_list_has_as_many_entries_as_it_has():
    with pytest.raises(UserError, match=r"^uncertainty\.coupling\.surface\.coefficients\.4: must be .*\.1 to \.3, was"):
        vary(
            load_scenario("flat", **{"coupling.surface": SOFT}, uncertainty={"coupling.surface.coefficients.4": FACTOR})
        )


def test_a_file_with_uncertainty_survives_the_round_trip(tmp_path):
    text = 'base = "paper"\n[uncertainty]\nplant.m_p = {distribution = "normal", mean = 5, std = 0.1}\n'
    text += '"plant.m2.1" = {distribution = "uniform", low = 1, high = 2}\n[requirements]\nforce_min = ">= -5"\n'
    (tmp_path / "mine.toml").write_text(text)
    scenario = load_scenario(tmp_path / "mine.toml")
    assert [entry.name for entry in scenario.uncertainty.entries()] == ["plant.m_p", "plant.m2.1"]
    (tmp_path / "again.toml").write_text(scenario.to_toml())
    assert load_scenario(tmp_path / "again.toml") == scenario
    narrow = scenario.with_overrides({"uncertainty.plant.m_p.std": 0.01})
    assert narrow.uncertainty.entries()[0].distribution.std == 0.01


def law(**changes):
    return {name: value for name, value in (FACTOR | changes).items() if value is not None}


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"plant.mp": FACTOR}, "uncertainty.plant.mp: must be a field of [plant] (did you mean m_p?), was unknown"),
        ({"plnt.m_p": FACTOR}, "uncertainty.plnt: must be one of loop, sensing"),
        ({"gains.k0": FACTOR}, "uncertainty.gains: must be one of loop, sensing"),
        ({"coupling.rows": FACTOR}, "uncertainty.coupling.rows: must be a field whose values are real numbers, was ("),
        ({"sensing.force_delay": FACTOR}, "uncertainty.sensing.force_delay: must be a field whose values are real"),
        ({"loop.control_period": law(low=0.001, high=0.002, relative=None)}, "uncertainty.loop.control_period: must"),
        ({"plant.gravity.1": FACTOR}, "uncertainty.plant.gravity.1: must be plant.gravity, which has no list of two"),
        ({"plant.m_p.3": FACTOR}, "uncertainty.plant.m_p.3: must be plant.m_p.1 to .2, was plant.m_p.3"),
        (
            {"plant.m_p": FACTOR, "plant.masses": FACTOR},
            "uncertainty.plant.m_p: must be given once, was given twice, by plant.m_p and plant.masses",
        ),
        ({"plant.m_p": FACTOR | {"1": FACTOR}}, "uncertainty.plant.m_p.1: must be left out beside plant.m_p, which"),
        ({"plant.masses": law(relative=None)}, "uncertainty.plant.masses.relative: must be true for masses, was false"),
        ({"initial.y": FACTOR}, "uncertainty.initial.y: must be a number that changes the simulation (a factor on 0"),
        ({"plant.m_p": law(low=-0.1)}, "uncertainty.plant.m_p: must be greater than 0, was -0.49"),
        ({"plant.m_p": law(low=None)}, "uncertainty.plant.m_p.low: must be given for uniform, was missing"),
        ({"plant.m_p": law(std=1.0)}, "uncertainty.plant.m_p.std: must be left out for uniform, was 1.0"),
        ({"plant.m_p": law(high=0.8)}, "uncertainty.plant.m_p.high: must be greater than low (0.8), was 0.8"),
        ({"plant.m_p": law(distribution="log_uniform", low=0)}, "uncertainty.plant.m_p.low: must be greater than 0"),
        ({"plant.m_p": law(offset=True)}, "uncertainty.plant.m_p.offset: must be left out where relative is true"),
        ({"plant.m_p": law(each=True, group="a")}, "uncertainty.plant.m_p.group: must be left out where each is true"),
        ({"plant.m_p": law(distribution=None)}, "uncertainty.plant.m_p.distribution: must be one of uniform, log_"),
        ({"plant.m_p": law(distribution="beta")}, "uncertainty.plant.m_p.distribution: must be 'uniform', 'log_"),
        ({"plant.m_p": law(lo=1)}, "uncertainty.plant.m_p.lo: must be one of distribution, low, high"),
        ({"plant.m_p": 5}, "uncertainty.plant.m_p: must be a table { distribution = ..., ... }, was 5"),
        ({"plant": 5}, "uncertainty.plant: must be a table of field = {...}, was 5"),
        (5, "uncertainty: must be a table of section.field = {...}, was 5"),
        (
            {"contact.tip_friction": law(low=0.1, high=0.2, relative=None)},
            "uncertainty.contact.tip_friction: must be such that sensing.force_lag is above 0",
        ),
    ],
)
def test_errors_name_the_entry(entries, message):
    with pytest.raises(UserError) as error:
        load_scenario("paper", uncertainty=entries)
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"force_mn": ">= 0"}, "requirements.force_mn: must be a metric, as coopmm simulate --out writes them"),
        ({"force_min": "0"}, "requirements.force_min: must be one of <=, >=, ==, <, > and a number, as in"),
        ({"force_min": ">= much"}, "requirements.force_min: must be one of <=, >=, ==, <, > and a number"),
        ({"force_min": 0}, "requirements.force_min: must be one of <=, >=, ==, <, > and a number"),
        (["force_min"], 'requirements: must be a table of metric = "<= limit"'),
    ],
)
def test_errors_name_the_requirement(given, message):
    with pytest.raises(UserError) as error:
        load_scenario("paper", requirements=given)
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(
    ("text", "met"), [("<= 2", "TTF"), ("< 2", "TFF"), ("== 2", "FTF"), (">= 2", "FTT"), ("> 2.0", "FFT")]
)
def test_requirements_compare(text, met):
    requirement = parse("force_min", text)
    values = np.array([1.0, 2.0, 3.0, np.nan])
    assert requirement.met(values).tolist() == [letter == "T" for letter in met] + [False]


def test_clopper_pearson_interval_is_that_of_beta_quantiles():
    interval = success(17, 20)
    assert interval.estimate == 0.85
    assert interval.low == pytest.approx(stats.beta.ppf(0.025, 17, 4), rel=1e-9)
    assert interval.high == pytest.approx(stats.beta.ppf(0.975, 18, 3), rel=1e-9)
    assert success(20, 20)[1:] == (pytest.approx(0.025 ** (1 / 20), rel=1e-9), 1.0)
