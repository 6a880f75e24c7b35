"""Trajectory as a notebook shows it."""

import dataclasses

import pytest

import coopmm_jax as cm
from coopmm_jax.metrics.table import METRICS, SHOWN


@pytest.fixture(scope="module")
def run():
    return cm.simulate(cm.load_scenario("paper", simulation={"duration": 0.02}))


def test_overview_is_among_the_package_s_names(run):
    figure = cm.overview(run)
    assert len(figure.axes) == 12
    assert figure.axes[0].get_xlabel() == "x [m]"


def test_html_tells_the_outcome_and_the_metrics_that_matter(run):
    page = run._repr_html_()
    assert "<b>Trajectory: 21 samples to 0.02 s, float64, OK</b>" in page
    assert page.count("<tr>") == page.count("</tr>") == len(SHOWN)
    force = f"<td>force_min</td><td>{run.metrics['force_min']:.4g}</td><td>N</td>"
    assert force in page
    assert METRICS["force_min"].meaning in page
    assert run.scenario.description in page.replace("&#x27;", "'")


def test_html_of_a_failed_run_says_why_and_escapes_text(run):
    scenario = run.scenario.with_overrides({"description": "<b>a & b"})
    failed = dataclasses.replace(run, status=cm.Status.SPEED, status_time=0.021, scenario=scenario)
    page = failed._repr_html_()
    assert "SPEED at 0.021 s</b><br>a velocity u left" in page
    assert "&lt;b&gt;a &amp; b" in page
