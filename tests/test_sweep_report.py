"""Results of a sweep: statistics, report, figures, one of its samples again."""

import html
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.status import Status
from coopmm_jax.sweeps import figures, report, statistics
from coopmm_jax.sweeps.measure import SERIES
from coopmm_jax.sweeps.statistics import read_results
from tests.reading import Reading
from tests.sweeps import MANY, REQUIRED, SENTENCES


def test_report_numbers(many):
    results = read_results(many)
    table = dict(zip(many.metric.values, many.metrics.values.T, strict=True))
    ok = many.status.values == Status.OK
    pressing = ok & (table["force_min"] >= -90)
    calm = ok & (table["torque_peak"] <= 200)
    spoken = [ok & (table[name] >= 0) for name in SENTENCES]
    rows = statistics.outcomes(results)
    all_met = np.logical_and.reduce([pressing, calm, *spoken])
    assert [row.passed for row in rows] == [int(met.sum()) for met in (ok, pressing, calm, *spoken, all_met)]
    assert 0 < rows[-1].passed < rows[0].passed < MANY
    force = table["force_min"][ok]
    summary = statistics.spread(results, "force_min")
    assert summary[:4] == (np.median(force), *np.quantile(force, [0.05, 0.95]), force.min())
    assert table["force_min"][summary.worst_sample] == force.min()
    assert statistics.spread(results, "force_max").worst == table["force_max"][ok].max()
    distance = {each.metric: statistics.robustness(results, each) for each in results.requirements}
    assert distance["torque_peak"].worst == pytest.approx(200 - table["torque_peak"][ok].max(), rel=1e-12)
    assert distance["recovers"].median == pytest.approx(np.median(table["recovers"][ok]), rel=1e-12)


def test_a_failed_rollout_is_below_every_other(many):
    failed, share = many.status.values != Status.OK, many.status_time.values / 0.05
    for name, scale in (("presses", 80.0), ("recovers", 60.0)):
        robustness = many.metrics.sel(metric=name).values
        assert robustness[~failed].min() > -1e6
        np.testing.assert_allclose(robustness[failed], -1e6 * scale * (2 - share[failed] * 50 / 51), rtol=1e-12)


def test_what_matters_is_found(many):
    results = read_results(many)
    assert statistics.telling(results) == ["completed", *REQUIRED]
    for metric in ("completed", "force_min", "torque_peak"):
        strongest, interval = next(iter(statistics.sensitivities(results, metric).items()))
        assert strongest == "disturbance.scale"
        assert interval.low < interval.estimate < interval.high
    assert statistics.worst_samples(results, "completed", 3).tolist() == results.index[~results.completed][:3].tolist()


def test_intervals_of_rank_correlation_cover_the_truth():
    rng = np.random.default_rng(0)
    r = 0.6
    truth = 6 / np.pi * np.arcsin(r / 2)  # Spearman's of a bivariate normal distribution
    pairs = rng.multivariate_normal([0, 0], [[1, r], [r, 1]], (400, 100))
    intervals = [statistics.rank_correlation(x, y) for x, y in pairs.transpose(0, 2, 1)]
    assert intervals[0].estimate == pytest.approx(stats.spearmanr(*pairs[0].T).statistic, rel=1e-14)
    covered = sum(interval.low <= truth <= interval.high for interval in intervals)
    assert 366 <= covered <= 392  # 95 % of 400, give or take three standard deviations


def test_report_text_and_files(rendered, kept, tmp_path):
    results = read_results(kept)
    text = report.text(results)
    assert "100 samples of 0.05 s, seed 0" in text
    failed = int((~results.completed | ~np.logical_and.reduce([results.met(r) for r in results.requirements])).sum())
    assert f"failed samples: {failed}\n" in text
    first = int(results.index[~results.completed][0])
    assert f"\n  {first:8}  SPEED at t = " in text
    report.write_report(tmp_path, kept)
    assert (tmp_path / "report.txt").read_text() == text + "\n"
    assert len((tmp_path / "failed.csv").read_text().splitlines()) == 1 + failed
    for name in ("bands", "importance", "requirements", "worst"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    page = Reading((tmp_path / "report.html").read_text())
    assert page.pictures == 4
    assert f"Samples without success: {failed}, the first {failed}" in page.text
    assert "coopmm sweep scenario.toml --samples 100 --sampling independent --keep 20 --batch 8" in page.text
    assert kept.attrs["scenario"] in page.text
    (row,) = (row for row in page.rows if row[0] == "all together")
    assert row[1] == f"{100 - failed} of 100"


def test_figures_show_the_numbers(kept):
    bands = figures.sweep_bands(kept)
    median = bands.axes[2].lines[0]
    np.testing.assert_allclose(median.get_ydata(), np.nanmedian(kept.contact_force.values, axis=0), rtol=1e-12)
    (desired,) = (line for line in bands.axes[2].lines if line.get_label() == "desired")
    assert set(desired.get_ydata()) == {15.0}
    (limit,) = (line for line in bands.axes[3].lines if line.get_label() == "limit")
    assert limit.get_ydata().tolist() == [200.0, 200.0]
    limits = figures.sweep_requirements(kept).axes
    bars, beyond = limits[0].patches
    assert (bars.get_hatch(), beyond.get_hatch()) == (None, "/////")
    assert beyond.get_zorder() < bars.get_zorder()
    assert [axes.get_xlabel() for axes in limits] == [
        "force_min [N]",
        "torque_peak [N m]",
        "robustness [N]",
        "robustness [N]",
    ]
    assert limits[0].get_title().startswith("force_min >= -90\nmet by 0.")
    assert bars.get_data().values.sum() == (kept.status.values == 0).sum()
    importance = figures.sweep_importance(kept).axes
    assert importance[1].get_yticklabels()[-1].get_text() == "disturbance.scale"
    worst = figures.sweep_worst(kept).axes[2]
    assert worst.get_title() == "10 worst of\ntorque_peak"
    assert worst.lines[-1].get_xdata().min() > 0.5


def test_figures_refuse_what_they_cannot_draw(many, sweep, scenario):
    with pytest.raises(UserError, match=r"^keep: must be at least 1 for bands over time, was 0$"):
        figures.sweep_bands(many)
    quiet = sweep(8, scenario.with_overrides({"requirements": {"contact_loss_fraction": "<= 1"}}), sampling="sobol")
    assert statistics.telling(read_results(quiet.isel(sample=slice(2)))) == []
    with pytest.raises(UserError, match=r"^sweep: must be one with samples that differ"):
        figures.sweep_worst(quiet.isel(sample=slice(2)))


def test_simulate_from_a_store(sweep, many, tmp_path, capsys):
    sweep(8, out=tmp_path / "sweep.zarr")
    assert main(["simulate", "--from", str(tmp_path / "sweep.zarr"), "--sample", "5"]) == 0
    *_, calm, _, _ = lines = capsys.readouterr().out.splitlines()
    force, torque = (float(many.metrics.sel(metric=name)[5]) for name in ("force_min", "torque_peak"))
    assert dict(line.split()[:2] for line in lines[2:])["force_min"] == f"{force:.6g}"
    met = "met" if torque <= 200 else "not met"
    assert calm == f"  requirement torque_peak <= 200: {met} (robustness {200 - torque:.4g} N m)"


def test_report_with_other_requirements(sweep, tmp_path, capsys):
    sweep(40, out=tmp_path / "sweep.zarr")
    assert main(["report", str(tmp_path / "sweep.zarr"), "--requirements.force-max", ">= 1e9"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^force_max >= 1e\+09 +0 of 40 +0.0000  0.0000 to 0.0881$", out, re.MULTILINE)
    assert out.endswith(f"written to {tmp_path / 'sweep-report'}\n")


def test_a_sentence_stays_as_it_was_swept_but_its_scale(many):
    swept = read_results(many).scenario
    scaled = swept.with_overrides({"requirements.presses": {"require": SENTENCES["presses"], "scale": 2.0}})
    assert read_results(many, scaled).metrics["presses"] is not None
    for other in ("presses", "more"):
        changed = swept.with_overrides({f"requirements.{other}": "always contact_force >= -70"})
        with pytest.raises(UserError, match=rf"^requirements\.{other}: must be "):
            read_results(many, changed)


def test_html_is_compact_and_starts_with_what_every_sample_has(kept):
    assert list(kept)[:4] == ["parameters", "metrics", "status", "status_time"]
    assert list(kept)[4:] == sorted(SERIES)
    page = html.unescape(kept._repr_html_())
    assert len(page) < 60_000
    assert all(meaning in page for _, meaning in SERIES.values())


def test_requirements_are_drawn_where_no_sample_completes(kept):
    lost = kept.isel(sample=kept.status.values != Status.OK)
    assert [axes.get_yscale() for axes in figures.sweep_requirements(lost).axes] == ["linear"] * 4


def test_bars_keep_their_width_far_from_the_limit(kept):
    results = read_results(kept)
    far = replace(results, scenario=results.scenario.with_overrides({"requirements.force_min": ">= 1e4"}))
    axes = figures.sweep_requirements(far).axes[0]
    counts, edges, _ = axes.patches[0].get_data()
    assert counts[0] > 0
    assert edges[1] - edges[0] > 0.02 * np.ptp(axes.get_xlim())
