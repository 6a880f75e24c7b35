"""Slopes of success probabilities against brute force: closed forms, moved limits, and sweeps with other gains."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from coopmm_jax.cli import main
from coopmm_jax.sweeps.slopes import ALL, Estimate, is_counted, slopes, weights
from coopmm_jax.sweeps.statistics import outcomes, read_results
from tests.reading import Reading
from tests.sweeps import MANY


def test_estimates_are_those_of_closed_forms():
    """P(x + y Z >= 0) of a normal Z has the slopes phi(x / y) / y by x and -x phi(x / y) / y^2 by y."""
    x, y, found = 0.7, 1.5, []
    for seed in range(50):
        z = np.random.default_rng(seed).normal(size=2000)
        found.append(Estimate.of(x + y * z, np.stack([np.ones_like(z), z], axis=1)))
    exact = norm.pdf(x / y) * np.array([1 / y, -x / y**2])
    off = np.array([one.slope for one in found]) - exact
    errors = np.array([one.error for one in found])
    assert np.abs(off.mean(axis=0)) == pytest.approx(0.0, abs=0.01)
    assert off.std(axis=0, ddof=1) == pytest.approx(errors.mean(axis=0), rel=0.25)


def test_failed_rollouts_and_constants_weigh_nothing():
    rho = np.array([-np.inf, 0.1, -0.1, 0.2, 5.0])
    assert weights(rho)[0] == 0.0
    assert np.all(weights(rho)[1:4] > 0)
    assert not weights(np.ones(5)).any()
    assert not weights(np.full(5, -np.inf)).any()


@pytest.fixture(scope="module")
def found(many):
    return slopes(many)


def test_slopes_by_a_limit_are_those_of_moving_it(many, found):
    results = read_results(many)
    for name, metric, by in (("force_min >=", "force_min", 8.0), ("torque_peak <=", "torque_peak", 30.0)):
        requirement = next(each for each in results.requirements if each.metric == metric)
        at = requirement.limit
        moved = [results.met(requirement._replace(limit=limit)).mean() for limit in (at - by, at + by)]
        (slope,) = (each for each in found if (each.requirement, each.number) == (str(requirement), name))
        assert slope.slope == pytest.approx((moved[1] - moved[0]) / (2 * by), abs=3 * slope.error)
        assert slope.error < abs(slope.slope) / 3
    only = [each for each in found if each.requirement.startswith("force_min") and each.number == "torque_peak <="]
    assert [(each.slope, each.error) for each in only] == [(0.0, 0.0)]


def test_slopes_by_a_gain_are_those_of_other_sweeps(found, scenario, sweep):
    gain, by = "K_lambda", 0.25
    at = getattr(scenario.gains, gain)
    ends = [
        {row.requirement: row.success.estimate for row in outcomes(read_results(sweep(MANY, scenario=changed)))}
        for changed in (scenario.with_overrides({f"gains.{gain}": at * factor}) for factor in (1 - by, 1 + by))
    ]
    checked = 0
    for each in found:
        if each.number == f"gains.{gain}":
            brute = (ends[1][each.requirement] - ends[0][each.requirement]) / (2 * by * at)
            # Of the samples that both sweeps share, those that change sides are counted: a Poisson number.
            changed = np.sqrt(MANY * abs(brute) * 2 * by * at + 1) / (MANY * 2 * by * at)
            assert each.slope == pytest.approx(brute, abs=3 * np.hypot(each.error, changed)), each
            checked += 1
    assert checked == 5


def test_slopes_are_printed_and_kept(many, found, scenario, tmp_path, monkeypatch, capsys):
    assert {each.requirement for each in found} == {*map(str, read_results(many).requirements), ALL}
    (tmp_path / "mine.toml").write_text(scenario.to_toml())
    monkeypatch.chdir(tmp_path)
    small = ("--samples", "64", "--batch", "8", "--keep", "0")
    assert main(["sweep", "mine.toml", *small, "--out", "mine.zarr", "--slopes"]) == 0
    out = capsys.readouterr().out
    assert "slopes of the success probability" in out
    with open("mine-report/slopes.csv") as file:
        rows = list(csv.DictReader(file))
    assert {row["number"] for row in rows} == {each.number for each in found}
    report = Path("mine-report/report.html")
    shown = {row[0] for row in Reading(report.read_text()).rows}
    assert {row["number"] for row in rows if float(row["slope"])} <= shown
    assert (
        "coopmm sweep scenario.toml --samples 64 --sampling independent --keep 0 --batch 8 --slopes"
        in report.read_text()
    )
    before = report.read_bytes()
    assert main(["report", "mine.zarr"]) == 0
    assert report.read_bytes() == before
    assert main(["report", "mine.zarr", "--requirements.force-min", ">= 3"]) == 0
    assert "Slopes" not in report.read_text()  # of the sweep's own requirements
    assert main(["sweep", "mine.toml", *small, "--out", "mine.zarr", "--resume"]) == 0
    assert not (tmp_path / "mine-report" / "slopes.csv").exists()  # the report may be of other samples


def test_one_sample_has_no_slopes(tmp_path, capsys):
    out = str(tmp_path / "one.zarr")
    assert main(["sweep", "uncertain", "--samples", "1", "--slopes", "--out", out]) == 2
    assert capsys.readouterr().err.endswith("--samples: must be at least 2 where --slopes is given, was 1\n")
    assert not (tmp_path / "one.zarr").exists()


def test_what_counts_samples_has_no_slope(scenario):
    counted = scenario.with_overrides({"requirements": {"contact_loss_fraction": "<= 0.5", "settling_time": "<= 1"}})
    by_name = {each.metric: is_counted(each) for each in counted.requirements.parsed()}
    assert [name for name, is_step in by_name.items() if is_step] == ["contact_loss_fraction", "settling_time"]
