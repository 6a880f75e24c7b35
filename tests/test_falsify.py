"""The search for the worst sample: closed-form costs in place of rollouts, then real ones in a process of their own."""

import csv

import jax
import numpy as np
import pytest

from coopmm_jax import cli
from coopmm_jax.parameters import PhaseSchedule
from coopmm_jax.runs.course import Course
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.scenario.variation import vary
from coopmm_jax.status import Status
from tests import falsify_results
from tests.reading import Reading
from tuning.cost import evaluate as batches
from tuning.cost.objective import FAILED, TERMS
from tuning.cost.problem import build_problem
from tuning.reports import worst
from tuning.search.ascent import LADDER, ascend
from tuning.studies import falsify

HIGH = np.array([1.0, 2.0, 1.0, 3.0])


class Hill:
    """Minus a skew quadratic around a point, on a box of four unlike sides; counts what is asked of it."""

    low, high, slope_price = np.zeros(4), HIGH, 3

    def __init__(self, centre, skew=0.0):
        self.centre, self.spent, self.calls = np.array(centre), 0, []
        self.curvature = np.diag([1.0, 3.0, 0.5, 2.0]) + skew * np.ones((4, 4))

    def values(self, points):
        assert np.all((self.low <= points) & (points <= self.high))
        self.spent += len(points)
        self.calls.append(points)
        away = points - self.centre
        return -np.sum((away @ self.curvature) * away, axis=1)

    def slopes(self, points, values):
        self.spent += self.slope_price * len(points)
        return -2.0 * (points - self.centre) @ self.curvature


def starts(count, seed=0):
    return np.random.default_rng(seed).random((count, 4)) * HIGH


@pytest.mark.parametrize(
    ("centre", "top"),
    [
        ((0.4, 1.5, 0.3, 0.9), (0.4, 1.5, 0.3, 0.9)),  # inside
        ((9.0, -9.0, 0.3, 0.9), (1.0, 0.0, 0.3, 0.9)),  # on a face of two dimensions
        ((9.0, -9.0, 9.0, -9.0), (1.0, 0.0, 1.0, 0.0)),  # at a corner
    ],
)
def test_finds_the_maximum_inside_on_a_face_and_at_a_corner(centre, top):
    found = ascend(Hill(centre), starts(8), budget=600)
    np.testing.assert_allclose(found.peaks[0].point, top, atol=0.06)
    assert found.peaks[0].value == pytest.approx(Hill(centre).values(np.array([top]))[0], abs=3e-3)


def test_a_corner_takes_one_round_and_is_known_to_be_a_top_without_further_trials():
    hill = Hill((9.0, -9.0, 9.0, -9.0))
    found = ascend(hill, starts(1), budget=600)
    np.testing.assert_array_equal(found.peaks[0].point, [1.0, 0.0, 1.0, 0.0])
    assert found.spent == 1 + (3 + len(LADDER)) + 3


def test_what_cannot_move_does_not_shorten_the_steps_of_the_rest():
    """The slope across the face is 1000 times the slopes along it."""
    hill = Hill((500.0, 1.5, 0.3, 0.9))
    start = np.array([[1.0, 0.5, 0.9, 2.5]])
    (moved,) = ascend(hill, start, budget=1 + 3 + len(LADDER)).peaks[:1]
    steps = np.abs(moved.point - start[0])
    assert steps[0] == 0.0
    assert steps[1:].max() > 0.2


@pytest.mark.parametrize("budget", [11, 40, 137])
def test_spends_what_it_says_and_never_more_than_the_budget(budget):
    hill = Hill((0.4, 1.5, 0.3, 0.9), skew=0.3)
    found = ascend(hill, starts(9), budget, climbers=3)
    assert found.spent == hill.spent <= budget
    assert [mark.value for mark in found.trail] == sorted(mark.value for mark in found.trail)
    assert found.trail[-1].spent == found.spent


def test_climbs_that_meet_go_on_as_one():
    """All starts reach the corner in their first round; there it is asked about once, and nothing is left to do."""
    hill = Hill((9.0, -9.0, 9.0, -9.0))
    found = ascend(hill, starts(4), budget=600, climbers=4)
    assert len(found.peaks) == 1
    assert found.spent == 4 + 4 * (3 + len(LADDER)) + 3


def test_a_value_that_is_enough_ends_the_search():
    found = ascend(Hill((9.0, -9.0, 9.0, -9.0)), starts(9), budget=600, enough=-1e9)
    assert found.spent == 9


def test_unbounded_distributions_are_searched_to_their_tails_and_others_to_their_ends():
    scenario = load_scenario(
        "paper",
        uncertainty={
            "plant.m_p": {"distribution": "uniform", "low": 4.0, "high": 6.0},
            "reference.contact_force": {"distribution": "normal", "mean": 15.0, "std": 2.0},
        },
    )
    variation = vary(scenario)
    low, high = falsify.box(variation)
    ends = [variation.values(end) for end in (low, high)]
    assert [end["plant.m_p"] for end in ends] == pytest.approx([4.0, 6.0], rel=1e-15)
    assert [end["reference.contact_force"] for end in ends] == pytest.approx([9.848341, 20.151659], rel=1e-7)


@pytest.fixture
def failing(monkeypatch):
    """Rollouts of which those with heavy platforms fail."""

    def evaluate(objective, vectors, samples):
        mass = samples.rows[:, 0] * 0.0 + heaviest(samples)
        lost = (mass > 5.5)[None].repeat(len(vectors), 0)
        terms = np.tile(mass[None, :, None], (len(vectors), 1, len(TERMS)))
        return batches.Evaluated(terms, ~lost, np.where(lost, 0.5, 1.0))

    def heaviest(samples):
        return jax.tree.unflatten(samples.structure, list(samples.rows.T)).plant.inertia[0].m_p

    def course(scenario, names):
        t = np.linspace(0.0, scenario.simulation.duration, 31)
        return Course(t, dict.fromkeys(names, 1.0 + t), Status.OK)

    monkeypatch.setattr(batches, "evaluate", evaluate)
    monkeypatch.setattr(worst, "course", course)


def test_a_rollout_that_fails_is_worst_of_all_and_ends_the_search(failing):
    mass = {"distribution": "uniform", "low": 4.0, "high": 5.6}
    scenario = load_scenario("paper", uncertainty={"plant.m_p": mass}, simulation={"seed": 4})
    found = falsify.falsify(scenario, rollouts=400, starts=4)
    assert found.failed
    assert found.cost >= FAILED
    assert found.numbers["plant.m_p"] > 5.5
    assert found.rollouts < 30
    assert "the rollout fails" in falsify.table(found, np.array([1.0, 2.0]))
    assert load_scenario("paper").plant.m_p == found.nominal["plant.m_p"] == 5.0


def test_worst_samples_are_different_ones_even_if_fewer_than_asked_for(failing):
    """Cost rises with the one number: every climb ends at its high end."""
    mass = {"distribution": "uniform", "low": 4.0, "high": 5.4}
    problem = build_problem(load_scenario("paper", uncertainty={"plant.m_p": mass}))
    samples = falsify.worst_samples(problem, problem.space.start, 1000)
    assert len(samples) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["paper"], "uncertainty: must be given"),
        (
            ["sensed", "--out", "{folder}/there.toml"],
            "--out: must be a place without results, or --overwrite given, was",
        ),
        (["sensed", "--out", "{folder}/worst.txt"], "--out: must be a .toml file"),
        (["sensed", "--out", "{folder}/there.toml/worst.toml"], "--out: must be a folder that can be written"),
        (["sensed", "--compare-random", "-3"], "--compare-random: must be at least 1"),
        (["sensed", "--gains-file", "{folder}/there.toml"], "--gains-file: must be"),
        (["sensed", "--rollout", "3"], "--rollout: must be an option of coopmm falsify (did you mean --rollouts?)"),
        (["sensed", "--rollouts", "12"], "rollouts: must be at least 41, for 32 starts and one step of a climb"),
        (["sensed", "--starts", "0"], "starts: must be at least 1"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(failing, tmp_path, capsys, arguments, message):
    (tmp_path / "there.toml").write_text("[plant]\n")
    arguments = [argument.format(folder=tmp_path) for argument in arguments]
    assert cli.main(["falsify", *arguments]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"coopmm: error: {message}")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["there.toml"]
    assert (tmp_path / "there.toml").read_text() == "[plant]\n"


def test_command_prints_numbers_and_writes_the_scenario(failing, tmp_path, capsys):
    out = tmp_path / "new" / "worst.toml"
    light = ["--simulation.duration", "3", "--plant.m-p", "4"]
    light += ["--schedule.phases", "0", "2", "--schedule.k2", "5", "8"]
    assert cli.main(["falsify", "sensed", *light, "--rollouts", "60", "--compare-random", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "plant.m_p                    4          4.8" in text
    assert "random samples: " in text
    page = Reading(out.with_suffix(".html").read_text())
    assert ["plant.m_p", "4", "4.8"] in page.rows
    assert page.pictures == 1
    assert "--rollouts 60 --starts 32" in page.text
    assert len([row for row in page.rows if "random samples" in row[0]]) == 1
    rows = list(csv.DictReader(out.with_suffix(".csv").read_text().splitlines()))
    assert ("plant.m_p", "4.0") in [(row["number"], row["scenario"]) for row in rows]
    before = out.with_suffix(".html").read_bytes()
    out.with_suffix(".html").unlink()
    assert cli.main(["report", str(out)]) == 0
    assert out.with_suffix(".html").read_bytes() == before
    written = load_scenario(out)
    assert written.plant.m_p == (4.8, 4.8) or written.plant.m_p == pytest.approx(4.8)
    assert written.uncertainty.entries() == ()
    assert written.parameters().schedule == PhaseSchedule((0.0, 2.0), {"k2": (5.0, 8.0)})
    assert written.description.startswith("Worst sample found of: Based on sensed (")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return falsify_results.results(tmp_path_factory.mktemp("falsify"))


def test_either_kind_of_gradient_is_that_of_differences_and_leads_to_the_same_sample(monkeypatch):
    """Of a closed form; through rollouts see test_required.py."""
    scenario = load_scenario("paper", **falsify_results.SCENARIO)
    problem = falsify_results.closed_problem(scenario)
    falsify_results.assert_alike(falsify_results.slopes(problem.cost, problem))
    by_differences = falsify.falsify(scenario, 80, 16, problem)
    monkeypatch.setattr(falsify, "DIFFERENCES", 0)
    by_reverse = falsify.falsify(scenario, 80, 16, problem)
    assert by_reverse.cost == pytest.approx(by_differences.cost, rel=1e-6)
    assert by_reverse.cost > 1.1 * by_reverse.nominal_cost
    assert by_reverse.rollouts != by_differences.rollouts


def test_the_written_scenario_has_the_same_cost_when_simulated(results):
    assert results["certain"]
    assert results["replayed"] == pytest.approx(results["cost"], rel=1e-12)
    assert results["nominal_replayed"] == pytest.approx(results["nominal_cost"], rel=1e-12)


def test_same_seed_same_bits(results):
    assert results["same"]


def test_worse_than_random_samples(results):
    assert results["cost"] > 1.3 * results["random"]
    rollouts, steps = results["spent"]
    assert rollouts <= 80
    assert steps == rollouts * round(falsify_results.HORIZON / 1e-3)


def test_samples_against_other_gains_come_worst_first(results):
    assert len(results["worst"]) == 3
    assert results["worst"] == sorted(results["worst"], reverse=True)
    assert results["worst"][0] == results["cost"]
