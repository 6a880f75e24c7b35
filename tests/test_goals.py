"""Requirements as goals of tuning: by hand, around closed-form robustness in the place of rollouts, and conflicts."""

import dataclasses
import functools
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import tuning
from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import load_scenario
from tests.closed_costs import MASS, QUICK, replace_rollouts, sizes
from tests.reading import Reading
from tuning.cost import goals as goals_module
from tuning.cost import required
from tuning.cost.goals import BLEND, PENALTY, Goals, soft_goal
from tuning.cost.objective import FAILED
from tuning.cost.problem import build_problem, unscaled
from tuning.reports import tune as report
from tuning.studies.conflict import Conflict, conflicting

HARD = {"require": ">= 0", "scale": 1.0, "hard": True}
REQUIREMENTS = {"force_min": HARD, "force_max": {"require": "<= 1", "hard": True}, "contact_loss_fraction": "<= 0.1"}


def scenario(requirements=REQUIREMENTS, **settings):
    settings = QUICK | {"goals": "requirements"} | settings
    return load_scenario("paper", uncertainty=MASS, requirements=requirements, tuning=settings)


def robustness_of(vector, size):
    """A ball for the first hard requirement, another for the second, which overlap; a soft one that pulls outside."""
    first = 2.0 - 0.3 * ((vector - 0.2) ** 2).sum(0) - 0.1 * size
    second = 2.0 - 0.3 * ((vector + 0.2) ** 2).sum(0) - 0.1 * size
    return first, second, 0.5 * vector[0] - 0.1 * (vector[1:] ** 2).sum(0)


def excluding(vector, size):
    """Robustness of two requirements that exclude each other, and of one at its limit."""
    return vector[0] - 0.1, -vector[0] - 0.1, 0.0 * vector[0]


@functools.partial(jax.jit, static_argnums=0)
def slopes(values, vectors, sizes, weights):
    def total(vector, size, weights):
        return sum(weight * value for weight, value in zip(weights, values(vector, size)))

    over_sizes = jax.vmap(jax.grad(total), in_axes=(None, 0, 0))
    return jax.vmap(over_sizes, in_axes=(0, None, 0))(vectors, sizes, weights)


@pytest.fixture
def closed(monkeypatch):
    """Closed forms instead of rollouts, of the cost as well."""
    replace_rollouts(monkeypatch)

    class Closed:
        values = staticmethod(robustness_of)
        lost = staticmethod(lambda vector: False)

    def evaluate(stated, vectors, samples, numbers, precision="float64"):
        found = Closed.values(vectors.T[..., None], sizes(samples.rows))
        found = np.stack([np.broadcast_to(each, (len(vectors), len(samples))) for each in found], axis=-1)
        lost = np.array([[Closed.lost(vector)] * len(samples) for vector in vectors])
        return required.Robustness(np.where(lost[..., None], -1.5 * FAILED, found), ~lost)

    def gradients(stated, vectors, samples, numbers):
        count = len(stated.limits)

        return np.array(slopes(Closed.values, vectors, sizes(samples.rows), numbers[..., :count]))

    monkeypatch.setattr(required, "evaluate", evaluate)
    monkeypatch.setattr(required, "gradients", gradients)
    monkeypatch.setattr(required, "compile_values", lambda *_: None)
    monkeypatch.setattr(required, "compile_gradients", lambda *_: None)
    return Closed


total = jax.jit(Goals.total, static_argnums=0)


def goals(**settings):
    problem = unscaled(scenario(**settings))
    assert isinstance(problem.goals, Goals)
    return problem.goals


def test_soft_goals_are_one_at_the_limit_smooth_and_positive():
    rho = jnp.array([-3.0, -1e-9, 0.0, 1e-9, 2.0])
    np.testing.assert_allclose(soft_goal(rho), [4.0, 1.0, 1.0, 1.0, np.exp(-2.0)], rtol=1e-8)
    np.testing.assert_allclose(jax.vmap(jax.grad(soft_goal))(rho), [-1.0, -1.0, -1.0, -1.0, -np.exp(-2.0)], rtol=1e-8)


def test_the_largest_soft_goal_of_a_robot_counts_and_the_mean_over_robots():
    stated = {"force_min": ">= 1", "force_max": "<= 1"}
    mine = goals(requirements=stated)
    robustness = jnp.array([[-2.0, 1.0], [-1.0, -1.0]])
    smooth = BLEND * np.log(np.mean(np.exp(np.array([3.0, np.exp(-1.0)]) / BLEND)))
    assert float(total(mine, robustness)) == pytest.approx((smooth + 2.0) / 2.0)
    assert smooth == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(
    ("settings", "missing"),
    [
        ({"hard_over": "worst"}, 0.55),  # of robustness -0.5, with the reserve
        ({"hard_over": "fraction", "hard_level": 0.75}, 0.15),  # one of four robots may break it
        ({"hard_over": "fraction", "hard_level": 0.76}, 0.55),
        ({"hard_over": "cvar", "hard_level": 0.5}, 0.35),  # the mean of the worse two
    ],
)
def test_hard_requirements_over_the_robots(settings, missing):
    mine = goals(requirements={"force_min": HARD, "contact_loss_fraction": "<= 0.1"}, **settings)
    robustness = jnp.array([[-0.5, 0.0], [-0.1, 0.0], [0.3, 0.0], [9.0, 0.0]])
    assert float(total(mine, robustness)) == pytest.approx(1.0 + PENALTY * missing)
    assert not mine.kept(robustness).any()
    assert mine.kept(jnp.abs(robustness)).all()
    assert float(total(mine, jnp.abs(robustness) + 0.05)) == pytest.approx(np.exp(-0.05))


def test_what_has_to_be_equal_needs_no_reserve():
    mine = goals(requirements={"contact_loss_fraction": {"require": "== 0", "hard": True}, "force_min": ">= 1"})
    assert float(total(mine, jnp.zeros((2, 2)))) == pytest.approx(1.0)


def test_a_robot_that_fails_costs_at_least_as_much_as_in_a_tuning_of_the_cost(closed):
    closed.lost = lambda vector: vector[0] > 0.5
    mine = unscaled(scenario()).goals
    vectors = np.stack([np.zeros(19), np.ones(19)])
    found = mine.assess(vectors, unscaled(scenario()).samples(0, 3))
    assert found.values[1] > FAILED > found.values[0]
    assert found.lost.tolist() == [False, True]


def test_slopes_are_those_of_differences(closed):
    """Beyond the limits of hard requirements, where the smooth maxima are close to the exact ones."""
    problem = unscaled(scenario(hard_over="cvar", hard_level=0.0))
    vector, samples = np.linspace(-0.6, 0.5, 19), problem.samples(0, 4)
    values, slopes = problem.slopes(vector[None], samples)
    steps = 1e-6 * np.concatenate([np.eye(19), -np.eye(19)])
    ahead, behind = np.split(problem.costs(vector + steps, samples), 2)
    assert values[0] == problem.costs(vector, samples)[0]
    np.testing.assert_allclose(slopes[0], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-5 * np.abs(slopes).max())


@pytest.mark.parametrize("optimiser", ["auto", "lbfgs"])
def test_tuning_keeps_hard_requirements_and_lowers_the_soft_goal(closed, optimiser):
    problem = build_problem(scenario(optimiser=optimiser))
    before = problem.goals.assess(np.full((1, 19), 0.9), problem.fixed)
    result = tuning.tune(scenario(optimiser=optimiser, budget=60.0))
    vector = np.log(result.after + np.array([gain.startswith("K_lambda") for gain in result.labels]))
    after = problem.goals.assess(vector[None], problem.fixed)
    assert not before.kept.all()
    assert after.kept.all()
    assert after.values[0] < 0.95 < before.values[0]
    assert result.conflict is None


def test_requirements_that_exclude_each_other_are_named(closed):
    closed.values = staticmethod(excluding)
    result = tuning.tune(scenario())
    names = tuple(map(str, result.scenario.requirements.parsed()[:2]))
    assert result.conflict is not None
    assert result.conflict.between == names
    assert (
        f"conflict: no candidate kept {names[0]} and {names[1]} together, though each alone was"
        in report.table(result).splitlines()
    )


def test_killed_and_resumed_is_uninterrupted_and_knows_the_conflict(closed, tmp_path):
    closed.values = staticmethod(excluding)
    whole = tuning.tune(scenario())

    def kill(row):
        if row.iteration == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tuning.tune(scenario(), out=tmp_path, progress=kill)
    resumed = tuning.tune(scenario(), out=tmp_path, resume=True)
    np.testing.assert_array_equal(whole.after, resumed.after)
    assert whole.conflict == resumed.conflict


def test_conflicts_are_the_smallest():
    kept = {(True, False, True), (False, True, True), (True, True, False)}
    assert conflicting(3, kept) == (0, 1, 2)
    assert conflicting(3, {(True, True, False)}) == (2,)
    assert conflicting(3, {(True, True, True)}) is None
    assert str(Conflict(("a",), ("a",), False)) == "no candidate kept a"
    assert "saw no conflict" in str(Conflict(("a",), (), True))
    few = str(Conflict(("a",), ("a", "b"), True))
    assert few == "conflict: no candidate checked on the fixed robots kept a and b together, though each alone was"


def test_the_report_says_what_holds_by_what_margin_and_how_certainly(closed, tmp_path):
    stated = {"force_min": HARD, "contact_loss_fraction": "<= 0.1"}
    closed.values = staticmethod(lambda vector, size: robustness_of(vector, size)[:2])
    result = tuning.tune(scenario(requirements=stated, budget=5.0), out=tmp_path)
    report.write_report(tmp_path, result)
    text = (tmp_path / "report.txt").read_text()
    assert "goals: soft requirements, as far as hard ones are kept by the worst robot" in text
    assert "all hard requirements: kept by 1.0000 (0.6306 to 1.0000) before" in text  # 8 of 8: 0.025^(1/8)
    rows = Reading((tmp_path / "report.html").read_text()).rows
    (hard,) = [row for row in rows if row[0] == "hard"]
    assert hard[1:5] == ["force_min >= 0", "N", "1 / 1 / 1", "1 / 1 / 1"]
    plain = dataclasses.replace(result, scenario=result.scenario.with_overrides({"tuning.goals": "cost"}))
    assert "goals:" not in report.table(plain)


def test_settings_that_do_not_fit_are_one_line(closed, capsys):
    with pytest.raises(UserError, match=r"requirements: must be given where tuning\.goals is requirements, was empty"):
        unscaled(scenario(requirements={}))
    assert main(["tune", "sensed", "--pareto", "3", "--tuning.goals", "requirements"]) == 2
    assert "tuning.goals: must be cost where --pareto is given" in capsys.readouterr().err


def test_the_scenario_of_the_user_guide_states_goals(tmp_path):
    page = (Path(__file__).parent.parent / "docs" / "howto" / "own_requirement.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```toml\n(# careful\.toml\n.*?)^```$", page, flags=re.M | re.S)
    (tmp_path / "careful.toml").write_text(text, encoding="utf-8")
    mine = unscaled(load_scenario(tmp_path / "careful.toml")).goals
    assert [each.metric for each in mine.requirements if each.hard] == ["presses", "joints_1", "joints_2"]
    assert [mine.requirements[i].metric for i in mine.soft] == ["force_error_rms_late", "error_late"]


def test_penalties_grow_slowly_beyond_one_scale():
    found = [float(goals_module.penalty(jnp.array(short))) for short in (-1.0, 0.0, 0.5, 1.0, np.e)]
    assert found == pytest.approx([0.0, 0.0, 0.5 * PENALTY, PENALTY, 2.0 * PENALTY])
