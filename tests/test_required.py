"""Requirements in searches: their robustness and slopes, samples that break them, different failures, ``check``."""

import csv

import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax import cli
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import plugins, registry
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.scenario.sections.requirements import parse
from coopmm_jax.sweeps.check import _checked
from coopmm_jax.sweeps.measure import Measured
from tests import falsify_results, required_results
from tuning.cost import required
from tuning.cost.problem import unscaled
from tuning.search.ascent import Ascent, Peak
from tuning.studies.falsify import requirement_of, said
from tuning.studies.modes import Failure, different, distance


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results with a plugin that is forgotten afterwards."""
    with pytest.MonkeyPatch.context() as patch:
        kinds = {group: dict(each) for group, each in registry._KINDS.items()}
        patch.setattr(registry, "_KINDS", kinds)
        patch.setattr(plugins, "_loaded", {})
        patch.setattr(plugins, "_contents", {})
        yield required_results.results(tmp_path_factory.mktemp("required"))


def test_the_sample_found_breaks_the_requirement_by_what_its_run_shows(results):
    """Robustness of the sentence, from the samples of an ordinary simulation of the scenario that was found."""
    found, run = results["found"], results["run"]
    contact = run.constraint_force[:, run.rows.index("contact_normal")]
    robustness = np.min(contact[run.t >= 0.02 - 1e-9]) - 13.5
    assert found.violated
    assert -found.cost * 2.0 == pytest.approx(robustness, rel=1e-9)
    assert found.scenario.description.endswith("over 0.1 s)")
    assert f"presses violated, robustness {robustness:.6g}" in found.scenario.description
    assert run.metrics["spread_worst"] == pytest.approx(np.max((run.velocity[:, 0, 0] - run.velocity[:, 1, 0]) ** 2))


def test_it_is_further_from_the_requirement_than_random_samples(results):
    assert results["found"].rollouts <= 80
    assert results["found"].cost > results["random"].max()


def test_slopes_of_a_metric_are_those_of_differences(results):
    falsify_results.assert_alike(results["of_metric"])


def test_slopes_of_sentences_are_those_of_differences(results):
    """The smooth extremes differ from the exact ones by less than their slopes are compared to."""
    for reverse, differences in (results["of_sentence"], results["of_all"]):
        scale = np.abs(differences).max()
        assert scale > 0.1
        np.testing.assert_allclose(reverse, differences, atol=0.1 * scale)


def test_slopes_by_tuned_gains_are_of_the_weighted_sum():
    """Of a closed form in the place of rollouts, each candidate on each sample with weights of its own."""

    class InClosedForm(required.Required):
        def evaluate(self, vector, parameters, numbers, smoothly=False):
            assert smoothly
            limits = numbers[len(self.limits) : 2 * len(self.limits)]
            return limits * parameters.plant.inertia[0].m_p * jnp.sum(vector**2), True

    problem = unscaled(required_results.scenario())
    stated = problem.scenario.requirements.parsed()
    mine = InClosedForm.of(problem.cost.objective, problem.scenario, stated)
    rng, samples = np.random.default_rng(0), problem.samples(0, 3)
    vectors, weights = rng.normal(size=(2, problem.start.size)), rng.uniform(size=(2, 3, len(stated)))
    masses = samples.parameters(np.arange(3)).plant.inertia[0].m_p
    found = required.gradients(mine, vectors, samples, mine.numbers(stated, weights))
    limits = np.array([each.limit for each in stated])
    np.testing.assert_allclose(found, 2.0 * (weights @ limits * masses)[..., None] * vectors[:, None], rtol=1e-14)


def test_a_plugins_signal_and_metric_are_required_like_any_other(results):
    (_, _, table) = results["checked"][0]
    spread = next(each for each in table["scenarios"] if each["scenario"] == "found_0")["robustness"]
    run = results["run"]
    speeds = run.velocity[:, 0, 0] - run.velocity[:, 1, 0]
    assert spread["spread_small: always spread <= 0.5"] == pytest.approx(0.5 - speeds.max(), rel=1e-9)
    assert spread["spread_worst <= 0.25"] == pytest.approx(0.25 - np.max(speeds**2), rel=1e-9)


def test_modes_are_different_failures(results):
    found, broken = results["modes"].found, results["modes"].broken
    assert 1 <= len(found) <= 2
    assert found[0].cost == results["found"].cost
    assert all("presses" in names for names in broken)
    assert len({tuple(each.numbers.values()) for each in found}) == len(found)


def test_check_says_which_scenarios_of_a_folder_fail_and_ends_with_1(results):
    code, text, table = results["checked"][0]
    assert code == 1
    assert not table["kept"]
    line = next(line for line in text.splitlines() if line.startswith("found_0"))
    assert line.startswith("found_0  FAILS  ")
    assert "presses -" in line
    first = table["scenarios"][0]
    assert first["robustness"][f"presses: {required_results.PRESSES}"] == pytest.approx(
        -2.0 * results["found"].cost, rel=1e-9
    )


def test_check_ends_with_0_where_all_is_kept(results):
    code, text, table = results["checked"][1]
    lost = [name for each in table["scenarios"] for name, value in each["robustness"].items() if value < 0.0]
    assert (code == 0) == table["kept"] == (not lost)
    assert text.splitlines()[-1].endswith("scenarios meet every requirement")


def test_a_rollout_that_fails_has_a_robustness_in_check_too():
    """That of the same rollout in a sweep, or in a search: -1e6 scales at the end, -2e6 at the start."""
    scenario = load_scenario("sensed", requirements={"presses": "always contact_force >= 5"})
    known, end = scenario.requirements.metrics(), (scenario.steps + 1) * scenario.sample_time
    metrics = np.full((2, len(known)), np.nan)
    measured = Measured(metrics, np.array([1, 1]), np.array([0.5 * end, 0.0]))
    half, none = (_checked("one", scenario, measured, row) for row in (0, 1))
    scales = {str(each): each.scale for each in scenario.requirements.parsed()}
    assert half.robustness == pytest.approx({name: -1.5e6 * scale for name, scale in scales.items()})
    assert none.robustness == pytest.approx({name: -2e6 * scale for name, scale in scales.items()})
    assert not half.kept


def failure(name, point, shortfall=1.0, broken=None, influence=(1.0, 1.0)):
    peak = Peak(np.array(point), shortfall)
    requirement = parse(name, ">= 0")
    return Failure(peak, requirement, broken or (name,), np.array(influence), Ascent([peak], [], 0))


def test_failures_are_different_by_what_they_break_or_where_they_lie():
    first, close = failure("force_min", (0.9, 0.9)), failure("force_min", (0.8, 0.8))
    far, other = failure("force_min", (0.1, 0.9)), failure("force_max", (0.9, 0.9))
    assert different([first, close, far, other], 3) == [first, other, far]  # what breaks something new comes first
    assert different([first, close], 2) == [first]


def test_what_does_not_matter_makes_no_failure_another():
    alike = failure("force_min", (0.1, 0.9), influence=(0.0, 1.0))
    assert different([failure("force_min", (0.9, 0.9), influence=(0.0, 1.0)), alike], 2)[1:] == []
    assert distance(np.zeros(2), np.array([1.0, 0.5]), np.array([0.0, 3.0])) == 0.5


def test_words_on_a_requirement():
    limit = parse("force_max", "<= 50")
    assert said(limit, 0.1) == "force_max <= 50 violated, robustness -5"
    assert said(limit, -0.1) == "force_max <= 50 kept, robustness 5"
    assert said(limit, 1.5e6) == "force_max <= 50 violated: the rollout fails"


def test_unknown_requirements_are_one_line():
    with pytest.raises(
        UserError, match=r"^--requirement: must be one of .* \(did you mean object_rms\?\), was objec_rms"
    ):
        requirement_of(load_scenario("sensed"), "objec_rms")
    with pytest.raises(UserError, match=r"^--requirement: must be of a scenario with \[requirements\], was force_min"):
        requirement_of(load_scenario("paper"), "force_min")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["falsify", "sensed", "--requirement", "nothing"], "--requirement: must be one of"),
        (["falsify", "sensed", "--modes", "0"], "--modes: must be at least 1"),
        (["falsify", "sensed", "--modes", "2", "--compare-random"], "--compare-random: must be left out"),
        (["falsify", "paper", "--modes", "2"], "--modes: must be of a scenario with [requirements]"),
        (["check", "{folder}/none"], "FOLDER: must be a folder with scenario files"),
        (["check", "{folder}"], "{folder}/free.toml: requirements: must be given"),
        (["check", "{folder}", "--out", "{folder}/table.txt"], "--out: must be a .json or .csv file"),
        (["check", "{folder}", "--gains-file", "{folder}/no.toml"], "--gains-file: must be"),
    ],
)
def test_bad_input_is_one_line(tmp_path, capsys, arguments, message):
    (tmp_path / "free.toml").write_text('base = "paper"\n', encoding="utf-8")
    assert cli.main([each.format(folder=tmp_path) for each in arguments]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"coopmm: error: {message.format(folder=tmp_path)}")
    assert err.count("\n") == 1


def test_tables_of_check_are_csv_too(results, capsys):
    out = results["folder"] / "checked.csv"
    assert cli.main(["check", str(results["folder"]), "--out", str(out)]) == 1
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert {row["unit"] for row in rows} == {"N", "rad/s", "N m"}
    assert [row["met"] for row in rows if row["requirement"].startswith("presses")] == ["0"] * (len(rows) // 4)
