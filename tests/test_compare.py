"""Several gain files on the same samples: pairing on real rollouts, statistics and figures on closed forms."""

import csv
import json

import numpy as np
import pytest
from matplotlib.figure import Figure

import coopmm_jax as cm
from coopmm_jax.cli import main
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.status import Status
from coopmm_jax.sweeps.measure import SERIES
from tests import compare_results
from tests.outlines import outlines
from tests.reading import Reading
from tuning.cost.objective import TERMS
from tuning.reports import compare, compare_figures
from tuning.studies.compare import OWN, ComparedGains
from tuning.studies.comparison import Comparison

SHORT = {
    "simulation": {"duration": 0.1},
    "nominal": {"scale": 0.8},
    "uncertainty": {
        "plant.masses": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True},
        "disturbance.scale": {"distribution": "uniform", "low": 0.0, "high": 4.0},
    },
    "tuning": {"tracking_from": 0.03, "validation_samples": 2, "test_samples": 3},
    "requirements": {"force_min": ">= 0", "force_error_rms": "<= 3.0"},
}
STIFF = "[gains]\nK_sigma = 5.0\nK_lambda = 4.0\n"
CERTAIN = '[gains]\nK_sigma = 25.0\n[law]\ncontroller = "model_based"\n'
OTHER = "[gains]\nK_a = 4.0\n[law]\ndelta_floor = 0.2\n"  # what [tuning] does not name


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gains")
    for name, text in {"stiff": STIFF, "other": OTHER, "certain": CERTAIN}.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "short.toml").write_text(cm.load_scenario("paper", **SHORT).to_toml())
    return folder


@pytest.fixture(scope="module")
def answer(files):
    return compare_results.results(files)


def arrays(compared, sets):
    """All that is known of some sets."""
    comparison = compared.comparison
    tables = [comparison.costs, comparison.terms, comparison.status, *comparison.metrics.values()]
    return [table[sets] for table in [*tables, *comparison.series.values()]]


def test_the_order_of_files_only_permutes(answer):
    assert answer["permuted"].labels == ("other", "scenario", "stiff", "other (2)")
    for one, permuted in zip(arrays(answer["compared"], [2, 0, 1, 2]), arrays(answer["permuted"], slice(None))):
        np.testing.assert_array_equal(one, permuted)


def test_a_file_against_itself_has_a_ratio_of_exactly_one(answer):
    found = [change for change in compare.changes(answer["permuted"], 3).values() if change.before]
    assert len(found) > 8
    assert all(change == (change.before, change.before, 1.0, 1.0) for change in found)


def test_a_sample_does_not_depend_on_how_many_others_there_are(answer):
    for one, alone in zip(arrays(answer["compared"], slice(2)), arrays(answer["alone"], slice(2))):
        np.testing.assert_array_equal(one[:, :1], alone)


def test_another_controller_changes_nothing_about_the_others(answer):
    for one, among in zip(arrays(answer["compared"], slice(None)), arrays(answer["controllers"], [1, 2, 3])):
        np.testing.assert_array_equal(one, among)


def test_a_file_with_another_controller_is_as_a_scenario_with_it(answer):
    """All but the cost, whose scales are those of the scenario's own gains."""
    file, own = (arrays(answer[name], [0])[1:] for name in ("controllers", "controlled"))
    for one, other in zip(file, own, strict=True):
        np.testing.assert_array_equal(one, other)


def test_numbers_are_those_of_simulate(answer):
    """Metrics of one sample; and the terms that are such metrics squared."""
    comparison = answer["controllers"].comparison
    assert len({tuple(row) for row in comparison.costs}) == 4
    for i, metrics in zip([1, 2, 3], answer["simulated"], strict=True):
        for name, value in metrics.items():
            found = comparison.metrics[name][i, compare_results.SAMPLE]
            np.testing.assert_allclose(found, value, rtol=1e-8, atol=1e-10, err_msg=name)
        terms = dict(zip(TERMS, comparison.terms[i, compare_results.SAMPLE], strict=True))
        assert terms["force"] == pytest.approx(metrics["force_error_rms"] ** 2, rel=1e-8)
        assert terms["effort"] == pytest.approx(10 * metrics["torque_rms"] ** 2, rel=1e-8)


def test_command_prints_and_writes(answer, files):
    code, printed = answer["command"]
    compared, out = answer["compared"], files / "out"
    assert code == 0
    assert compare.table(compared) in printed
    names = {"compare.txt", "compare.json", "compare.csv", "costs.png", "bands.png", "requirements.png"}
    names |= {"costs.csv", "requirements.csv", "report.html", "page.json"}
    assert {path.name for path in out.iterdir()} == names
    rows = list(csv.DictReader((out / "compare.csv").read_text().splitlines()))
    assert [(row["sample"], row["gains"]) for row in rows[:4]] == [*(("0", x) for x in compared.labels), ("1", OWN)]
    assert [float(row["cost"]) for row in rows[1::3]] == compared.comparison.costs[1].tolist()
    page = Reading((out / "report.html").read_text())
    assert page.pictures == 3
    assert "stiff against scenario" in page.text
    assert (
        f"coopmm compare scenario {files / 'stiff.toml'} {files / 'other.toml'} --scenario scenario.toml" in page.text
    )
    content = json.loads((out / "compare.json").read_text())
    assert content["values"]["cost, mean"]["stiff"] == pytest.approx(compared.comparison.costs[1].mean())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["stiff"], "GAINS: must be at least two gain files, or one and the word scenario, was 1"),
        (["stiff", "none"], "GAINS: must be a file that can be read, or the word scenario, was"),
        (["stiff", "broken"], "GAINS: must be a TOML file, or the word scenario, was"),
        (["stiff", "short"], "GAINS: must be a file of [gains], [law] and [schedule], or the word scenario, was"),
        (["stiff", "unknown"], "gains.K_sigmaa: must be a field of [gains] (did you mean K_sigma?), was unknown"),
        (["stiff", OWN, "--samples", "0"], "--samples: must be at least 1, was 0"),
        (["stiff", OWN, "--scenario", "paper"], "uncertainty: must be given"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(files, capsys, arguments, message):
    (files / "broken.toml").write_text("gains = [")
    (files / "unknown.toml").write_text("[gains]\nK_sigmaa = 1.0\n")
    words = [
        word if word.startswith("-") or word in (OWN, "paper", "0") else f"{files / word}.toml" for word in arguments
    ]
    out = files / "never"
    assert main(["compare", "--scenario", "sensed", *words, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()
    assert not list(files.glob(".never*"))


def made_up(failing=0):
    """Three sets on 20 samples: the second halves costs, the third fails in the first ``failing`` samples."""
    rng = np.random.default_rng(0)
    costs = rng.lognormal(size=20) * np.array([[1.0], [0.5], [2.0]])
    status = np.zeros((3, 20), int)
    status[2, :failing] = Status.SPEED
    metrics = {name: rng.uniform(0.0, 1.0, (3, 20)) for name in METRICS}
    metrics["force_min"] = np.repeat([[-1.0], [1.0], [1.0]], 20, axis=1)
    metrics["force_min"][0, :12] = 2.0
    metrics["force_min"][1, 0] = -1.0
    series = {name: rng.uniform(0.1, 1.0, (3, 5, 30)) for name in SERIES}
    for values in series.values():
        values[2, :failing, 20:] = np.nan
    terms = np.where(status[..., None] == 0, costs[..., None] * np.arange(1.0, 10.0), 1e9)
    comparison = Comparison(costs, terms, metrics, status, np.linspace(0.0, 2.0, 30), series)
    return ComparedGains(cm.load_scenario("sensed", **SHORT), (OWN, "stiff", "other"), comparison)


def test_ratios_of_halved_costs_are_a_half_however_samples_are_drawn():
    for change in compare.changes(made_up(), 1).values():
        assert (change.low, change.high) == pytest.approx((0.5, 0.5), rel=1e-12)


def test_a_failed_rollout_fails_its_requirements_and_its_terms_do_not_count():
    compared = made_up(failing=3)
    met = compared.outcomes()
    assert met["completed"].sum(axis=1).tolist() == [20, 20, 17]
    assert met["force_min >= 0"].sum(axis=1).tolist() == [12, 19, 17]
    assert np.array_equal(met["all together"], np.logical_and.reduce(list(met.values())[:-1]))
    for name, change in compare.changes(compared, 2).items():
        if not name.startswith("cost"):
            assert (change.low, change.high) == pytest.approx((2.0, 2.0), rel=1e-12)
    assert "0.850 (0.621 to 0.968)" in compare.table(compared)


def test_switches_are_mcnemars():
    met = made_up().outcomes()["force_min >= 0"]
    won, lost = compare.switches(met)[0][:2]
    assert (won, lost) == (8, 1)
    assert compare.switches(met)[0].p == pytest.approx(2 * (1 + 9) / 2**9)  # at most 1 of 9, either way
    assert compare.switches(np.ones((2, 9), bool))[0] == (0, 0, 1.0)


@pytest.mark.parametrize(("small", "failing"), [(False, 3), (True, 20)])
@pytest.mark.parametrize(("name", "rows", "columns"), [("requirements", 6, 1), ("costs", 2, 1), ("bands", 4, 3)])
def test_figures(name, rows, columns, small, failing):
    """Labelled, and inside the page at both sizes, however many rollouts fail."""
    axes = None
    if small:
        axes = Figure(figsize=(3.2 * columns, 1.9 * rows), layout="constrained").subplots(rows, columns)
    figure = getattr(compare_figures, name)(made_up(failing), axes=axes)
    assert len(figure.axes) == rows * columns
    boxes = outlines(figure, rendered=not small)
    assert all(panel.get_xlabel() for panel in figure.axes[-columns:])
    assert all(box.x0 >= -1 and box.y0 >= -1 and box.y1 <= figure.bbox.y1 + 1 for box in boxes)
