"""The figure of a sample that hurts: which signals and limits it shows, and that they are those of the run."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from coopmm_jax.metrics.table import METRICS
from coopmm_jax.plotting import style
from coopmm_jax.runs.course import Course, course
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.scenario.sections.requirements import parse
from coopmm_jax.status import Status
from coopmm_jax.temporal_logic.signals import SIGNALS
from tuning.reports.asked import levels, signals
from tuning.reports.worst import over_time

T = np.linspace(0.0, 2.0, 201)


def test_every_metric_has_a_signal():
    for name in METRICS:
        (signal,) = signals(parse(name, "<= 1"))
        assert signal in SIGNALS, name


@pytest.mark.parametrize(
    ("name", "text", "shown"),
    [
        ("force_min", ">= 5", [("contact_force", 5.0, 0.0, 2.0)]),
        ("error_late", "<= 0.01", [("tracking_error", 0.01, 1.5, 2.0)]),
        ("settling_time", "<= 0.5", [("tracking_error", 0.01, 0.5, 2.0)]),
        ("contact_loss_fraction", "== 0", [("contact_force", 0.0, 0.0, 2.0)]),
        ("position_max_1", "<= 0.1", [("position_error_1", 0.1, 0.0, 2.0)]),
        ("torque_variation", "<= 90", []),
        ("s", "always[0.5, 1] -3 <= velocity_1[u1]", [("velocity_1[u1]", -3.0, 0.5, 1.0)]),
        ("s", "eventually[0, 1] always abs(force_error) <= 2", [("force_error", x, 0.0, 2.0) for x in (2.0, -2.0)]),
        (
            "s",
            "always[1, inf] gap <= 0 and torque <= 9",  # the second of the first instant alone
            [("gap", 0.0, 1.0, 2.0), ("torque", 9.0, 0.0, 0.0)],
        ),
        ("s", "always contact_force >= 0.5 * desired_force", []),
    ],
)
def test_limits_are_drawn_where_and_when_they_count(name, text, shown):
    requirement = parse(name, text)
    found = levels(requirement, duration=2.0)
    assert [level[:4] for level in found] == shown
    assert {level.signal for level in found} <= set(signals(requirement))


def made(level, status=Status.OK, samples=None):
    names = ("contact_force", "tracking_error", "object_error", "torque")
    return Course(T[:samples], {name: level + np.sin(T[:samples]) for name in names}, status)


@pytest.mark.parametrize("samples", [0, 1, 120])
def test_figure_of_the_cost_shows_a_failure(samples):
    figure = over_time(load_scenario("sensed"), None, made(2.0, Status.SPEED, samples), made(1.5))
    FigureCanvasAgg(figure).draw()
    assert [axes.get_ylabel() for axes in figure.axes][::3] == ["contact force [N]", "torque [N m]"]
    for axes in figure.axes:
        labels = [line.get_label() for line in axes.lines]
        end = T[samples - 1] if samples else 0.0
        assert f"SPEED at {end:.3g} s, sample found" in labels
        assert "scenario itself" in labels
    assert "desired" in [line.get_label() for line in figure.axes[0].lines]


def test_figure_of_a_requirement_has_its_limit():
    figure = over_time(
        load_scenario("sensed"), parse("presses", "always[0.5, 1] contact_force >= 12"), made(2), made(3)
    )
    FigureCanvasAgg(figure).draw()
    (axes,) = figure.axes
    limit = next(line for line in axes.lines if line.get_label() == "limit")
    np.testing.assert_array_equal(limit.get_xydata(), [[0.5, 12.0], [1.0, 12.0]])
    assert limit.get_color() == style.LIMIT["color"]


def test_signals_are_those_of_the_run(simulated_paper):
    run, wanted = simulated_paper, ["contact_force", "force_error", "torque_2[joint_1]"]
    found = course(run.scenario, wanted)
    contact = run.rows.index("contact_normal")
    force, desired = run.constraint_force[:, contact], run.constraint_force_desired[:, contact]
    assert found.status is run.status
    np.testing.assert_allclose(found.t, run.t, rtol=1e-12)
    np.testing.assert_allclose(found.values["contact_force"], force, rtol=1e-12)
    np.testing.assert_allclose(found.values["force_error"], force - desired, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.values["torque_2[joint_1]"], run.torque[:, 1, 2], rtol=0, atol=1e-12)
