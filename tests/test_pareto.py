"""The front between quality and effort, around closed-form costs in the place of rollouts."""

import csv
from dataclasses import replace

import jax
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from coopmm_jax.cli import main
from coopmm_jax.scenario.gains_file import read_gains
from coopmm_jax.scenario.scenario import load_scenario
from tests.reading import Reading
from tuning.cost import evaluate as batches
from tuning.cost.objective import FAILED, TERMS
from tuning.cost.problem import build_problem
from tuning.cost.risk import risk
from tuning.cost.robust_cost import RobustCost
from tuning.reports import pareto as pareto_report
from tuning.studies import pareto
from tuning.studies.pareto import Front, non_dominated, tune_front

MASS = {"plant.m_p": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}}
SMALL = {"validation_samples": 4, "test_samples": 8, "screening_samples": 2, "samples": 2, "starts": 16, "budget": 60.0}
IS_EFFORT = np.array([name in pareto.EFFORT for name in TERMS])


def scenario(**settings):
    return load_scenario("paper", uncertainty=MASS, tuning={"channels": "shared"} | SMALL | settings)


def terms_of(vectors, rows):
    """Every term of quality is |x - 1|^2, of effort |x + 1|^2, times a factor that depends on the sample (C, N, 9)."""
    quality, effort = (np.sum((vectors - place) ** 2, axis=1) for place in (1.0, -1.0))
    return np.where(IS_EFFORT, effort[:, None], quality[:, None])[:, None, :] * weight_of(rows)[None, :, None] + 1e-3


def weight_of(rows):
    """A number of each sample (N,) around 1."""
    return 1.0 + 0.1 * np.mean(np.where(np.abs(rows) < 100.0, rows, 0.0), axis=1)  # no limits, no stream's number


@pytest.fixture
def rollouts(monkeypatch):
    """Closed forms instead of rollouts."""

    def evaluate(objective, vectors, samples, precision="float64"):
        terms = terms_of(np.asarray(vectors), samples.rows)
        return batches.Evaluated(terms, np.ones(terms.shape[:2], bool), np.ones(terms.shape[:2]))

    def gradients(objective, vectors, samples, coefficients):
        x = np.asarray(vectors)
        coefficients = np.broadcast_to(coefficients, (len(x), len(TERMS)))
        costs = evaluate(objective, x, samples).costs(coefficients[:, None, :])
        places = np.where(IS_EFFORT, -1.0, 1.0)
        slopes = 2.0 * np.sum(coefficients[:, :, None] * (x[:, None, :] - places[:, None]), axis=1)
        return costs, slopes[:, None, :] * weight_of(samples.rows)[None, :, None]

    monkeypatch.setattr(batches, "evaluate", evaluate)
    monkeypatch.setattr(batches, "gradients", gradients)
    monkeypatch.setattr(batches, "compile_gradients", lambda *_: None)


def test_non_dominated_against_the_definition():
    points = np.random.default_rng(0).integers(0, 5, size=(60, 2)).astype(float)  # ties among them
    expected = [not any(np.all(other <= point) and np.any(other < point) for other in points) for point in points]
    assert non_dominated(points).tolist() == expected
    assert 0 < sum(expected) < len(points)


def test_a_convex_curve_dominates_nothing_and_everything_behind_it():
    angle = np.linspace(0.0, np.pi / 2, 9)
    curve = 1.0 - np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert non_dominated(curve).all()
    assert non_dominated(np.concatenate([curve, curve + 0.2])).tolist() == [True] * 9 + [False] * 9


def test_front_of_two_quadratics(rollouts):
    """(a |x - 1|^2 + b |x + 1|^2) is least at (a - b) / (a + b), with a and b from the weight and the scales."""
    settings = scenario()
    front = tune_front(settings, 4)
    problem = build_problem(settings)
    scales = problem.cost.coefficients / np.array([getattr(settings.tuning.weights, name) for name in TERMS])
    assert front.weights == pytest.approx(np.geomspace(0.01, 10.0, 4))
    for weight, gains in zip(front.weights, front.gains, strict=True):
        a, b = scales[0], weight * scales[-1]
        expected = problem.space.gains(problem.space.inside(np.full(problem.space.size, (a - b) / (a + b))))
        np.testing.assert_allclose(jax.tree.leaves(gains), jax.tree.leaves(expected), rtol=1e-3)
    assert not front.dominated.any()
    assert np.all(np.diff(front.points[1:, 0]) > 0.0)
    assert np.all(np.diff(front.points[1:, 1]) < 0.0)
    np.testing.assert_allclose(front.validation[0], 1.0, rtol=1e-3)  # the scenario's gains, on others than scaled it


def test_same_seed_same_bits(rollouts):
    first, again = (tune_front(scenario(budget=10.0), 3) for _ in range(2))
    np.testing.assert_array_equal(first.values, again.values)
    np.testing.assert_array_equal(first.points, again.points)


def test_what_one_weighting_finds_serves_another(rollouts):
    """Every weighting has the best of all that was checked."""
    front = tune_front(scenario(budget=4.0), 3)
    for i, weight in enumerate(front.weights):
        costs = front.tried @ [1.0, weight]
        assert front.validation[i + 1] @ [1.0, weight] == pytest.approx(costs.min(), rel=1e-9)


def test_risk_of_a_weighting_is_that_of_its_costs(rollouts):
    problem = build_problem(scenario())
    vectors, samples = np.random.default_rng(3).normal(size=(4, problem.space.size)), problem.samples(0, 5)
    coefficients = np.random.default_rng(4).uniform(size=9)
    with jax.enable_x64(True):
        values = RobustCost(problem.cost.objective, coefficients, risk("cvar", 0.5)).values(vectors, samples)
        expected = [risk("cvar", 0.5)(row @ coefficients) for row in terms_of(vectors, samples.rows)]
    np.testing.assert_allclose(values, expected, rtol=1e-12)


def made_up():
    """Four weightings: the second is dominated by the third, the last two share their gains; one try failed."""
    points = np.array([[1.0, 1.0], [0.1, 3.0], [0.5, 1.5], [0.4, 0.8], [0.4, 0.8]])
    settings = scenario()
    gains = settings.parameters().gains
    values = np.arange(10.0).reshape(5, 2)
    tried = np.concatenate([0.9 * points, [[FAILED, FAILED]]])
    return Front(
        settings, ["K_I", "gamma"], np.geomspace(0.01, 10.0, 4), [gains] * 4, [None] * 4, values, points, points, tried
    )


@pytest.mark.parametrize("small", [False, True])
def test_picture_marks_what_is_dominated(small):
    axes = Figure(figsize=(3.2, 2.4), layout="constrained").subplots() if small else None
    figure = pareto_report.picture(made_up(), axes=axes)
    FigureCanvasAgg(figure).draw()
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert lines["the same, dominated"].get_xydata().tolist() == [[1.5, 0.5]]
    assert lines["untouched samples"].get_xydata().tolist() == [[0.8, 0.4], [0.8, 0.4], [3.0, 0.1]]
    assert len(lines["tried (validation)"].get_xdata()) == 5
    assert [text.get_text() for text in figure.axes[0].texts] == ["0.01", "0.1", "1, 10"]


def test_table_says_what_is_dominated():
    lines = pareto_report.table(made_up()).splitlines()
    assert [line.endswith("dominated") for line in lines[4:]] == [False, True, False, False]


def test_command_writes_gains_that_can_be_used_and_overwrites_nothing(rollouts, tmp_path, capsys):
    path, out = tmp_path / "scenario.toml", tmp_path / "front"
    path.write_text(scenario(budget=10.0).to_toml())
    assert main(["tune", str(path), "--pareto", "3", "--out", str(out)]) == 0
    names = {"front.csv", "front.txt", "front.png", "gains_01.toml", "gains_02.toml", "gains_03.toml"}
    assert {file.name for file in out.iterdir()} == names | {"report.html", "page.json"}
    assert (out / "front.txt").read_text() in capsys.readouterr().out
    rows = list(csv.DictReader((out / "front.csv").read_text().splitlines()))
    assert [row["gains"] for row in rows] == ["start", "gains_01.toml", "gains_02.toml", "gains_03.toml"]
    for row in rows[1:]:
        gains = load_scenario("paper", **read_gains(out / row["gains"])).parameters().gains
        assert gains.K_I[0] == float(row["K_I"])
    before = {file: file.read_bytes() for file in out.iterdir()}
    assert main(["tune", str(path), "--pareto", "3", "--out", str(out)]) == 2
    assert "--out: must be a place without results, or --resume or --overwrite given, was" in capsys.readouterr().err
    assert {file: file.read_bytes() for file in out.iterdir()} == before


def test_the_page_has_the_front_its_figure_and_every_gain(tmp_path, capsys):
    made = made_up()
    evil = made.scenario.with_overrides({"description": "<script>alert(1)</script>"})
    pareto_report.write_report(tmp_path, replace(made, scenario=evil))
    text = (tmp_path / "report.html").read_text()
    page = Reading(text)
    assert "<script" not in text
    assert page.pictures == 1
    assert page.rows[1][:4] == ["start", "", "1", "1"]
    assert page.rows[3] == ["gains_02.toml", "0.1", "0.5", "1.5", "0.5", "1.5", "yes"]
    assert ["gamma", "", "1", "3", "5", "7", "9"] in page.rows
    assert main(["report", str(tmp_path)]) == 0
    assert (tmp_path / "report.html").read_text() == text
    assert capsys.readouterr().out == f"written to {tmp_path / 'report.html'}\n"


@pytest.mark.parametrize("over", ["time", "phase"])
def test_a_front_of_gains_that_change(rollouts, tmp_path, over):
    settings = scenario(budget=4.0, schedule=2, schedule_over=over)
    front = tune_front(settings, 2)
    pareto_report.write_report(tmp_path, front)
    for i, schedule in enumerate(front.schedules, 1):
        found = settings.with_overrides(read_gains(tmp_path / f"gains_{i:02d}.toml")).parameters().schedule
        assert (type(found), found) == (type(schedule), schedule)
        assert found.values["K_I"][1][0] == front.values[i, -1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--pareto", "1"], "--pareto: must be from 2 to 1000 weightings, was 1"),
        (["--pareto", "2", "--resume"], "--resume: must be left out where --pareto is given"),
        (["--pareto", "2", *(f"--tuning.weights.{name}=0" for name in pareto.EFFORT)], "one term of effort"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, capsys, arguments, message):
    assert main(["tune", "sensed", *arguments, "--out", str(tmp_path / "front")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
