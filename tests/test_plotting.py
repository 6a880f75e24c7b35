"""Figures: labelled, legible at two sizes, faithful to peaks, and able to draw runs that failed."""

import dataclasses
import functools
import itertools

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import coopmm_jax as cm
from coopmm_jax import plotting
from coopmm_jax.plotting import lines, style
from coopmm_jax.status import Status
from tests.outlines import outlines

# Every figure of one run: how to draw it, and its number of panels.
FIGURES = {
    "platform_paths": (plotting.platform_paths, 1),
    "platform_angle": (functools.partial(plotting.platform_angle, robot="I"), 2),
    "arm_angles": (functools.partial(plotting.arm_angles, robot="II"), 2),
    "chained_errors": (plotting.chained_errors, 2),
    "torques": (functools.partial(plotting.torques, robot="II"), 2),
    "contact_force": (plotting.contact_force, 3),
    "constraint_forces": (plotting.constraint_forces, 1),
    "constraint_residual": (plotting.constraint_residual, 1),
    "filtered_error": (plotting.filtered_error, 2),
    "adaptation": (plotting.adaptation, 1),
    "overview": (plotting.overview, 12),
}
COMPARING = sorted(set(FIGURES) - {"overview"})
each_figure = pytest.mark.parametrize("name", FIGURES)


@pytest.fixture(scope="module")
def run():
    """The paper's start, in which the contact is lost."""
    return cm.simulate(cm.load_scenario("paper", simulation={"duration": 1.0}))


@pytest.fixture(scope="module")
def heavy_object(run):
    return cm.simulate(run.scenario.with_overrides({"plant.m_obj": 1.0}))


@pytest.fixture(scope="module")
def failed(run):
    """The paper's bounds at their true values are too stiff for a step of 1 ms."""
    trajectory = cm.simulate(run.scenario.with_overrides({"gains.beta": 126.7, "gains.lam_min": 0.63}))
    assert not trajectory.ok
    return trajectory


def resampled(run, samples, **changes):
    """A run whose arrays over time have another length."""

    def longer(values):
        over_time = (item for item in values.items() if isinstance(item[1], np.ndarray) and len(item[1]) == len(run.t))
        return {name: np.resize(value, (samples, *value.shape[1:])) for name, value in over_time}

    arrays = longer(vars(run)) | {"controller": longer(run.controller), "t": 1e-3 * np.arange(samples)}
    return dataclasses.replace(run, **arrays | changes)


def texts(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def check_labelled(figure, panels):
    assert isinstance(figure, Figure)
    assert len(figure.axes) == panels
    for axes in figure.axes:
        assert all("[" in label and "]" in label for label in (axes.get_xlabel(), axes.get_ylabel()))


def test_every_public_figure_is_tested():
    """Those of sweeps are tested with sweeps, ``series`` by the notebook that it is for."""
    elsewhere = {name for name in plotting.__all__ if name.startswith("sweep_")} | {"series"}
    assert {*FIGURES, "caption", "save"} | elsewhere == set(plotting.__all__)


@pytest.mark.parametrize("name", [*FIGURES, "caption", "save"])
def test_there_is_an_example(name):
    assert ">>> " in getattr(plotting, name).__doc__


@each_figure
def test_panels_have_data_and_units(name, run):
    draw, panels = FIGURES[name]
    figure = draw(run)
    check_labelled(figure, panels)
    assert all(len(axes.lines[0].get_xdata()) > 1 for axes in figure.axes)


@each_figure
def test_failed_run_is_drawn_up_to_its_failure(name, failed):
    draw, panels = FIGURES[name]
    figure = draw(failed)
    check_labelled(figure, panels)
    assert all(len(axes.lines[0].get_xdata()) == len(failed.t) > 1 for axes in figure.axes)


@each_figure
@pytest.mark.parametrize("samples", [0, 1])
def test_run_that_fails_at_once(name, samples, run):
    draw, panels = FIGURES[name]
    figure = draw(resampled(run, samples, status=Status.SPEED, status_time=0.0))
    check_labelled(figure, panels)
    figure.set_layout_engine("none")  # which takes as long as drawing, and goes by labels, not by data
    figure.draw_without_rendering()


def test_failure_is_named_in_the_legend(failed):
    axes = plotting.adaptation(failed).axes[0]
    assert f"{failed.status.name} at {failed.status_time:.3g} s" in texts(axes)
    assert axes.lines[-1].get_xdata()[0] == failed.status_time


@each_figure
def test_as_many_axes_are_given_as_there_are_panels(name, run):
    draw, panels = FIGURES[name]
    with pytest.raises(cm.UserError, match=rf"axes: must be {panels} matplotlib axes"):
        draw(run, axes=[Figure().subplots()] * (panels + 1))


def test_single_axes_need_no_list(run):
    axes = Figure().subplots()
    assert plotting.adaptation(run, axes=axes).axes == [axes]


@each_figure
@pytest.mark.parametrize("small", [False, True])
def test_nothing_overlaps(name, small, run):
    """Panels with their labels and legends stay apart and inside the figure, also one's own; legends off the data."""
    draw, panels = FIGURES[name]
    if small:
        rows, columns = (3, 4) if panels == 12 else (panels, 1)
        figure = Figure(figsize=(3.2 * columns, 1.9 * rows), layout="constrained")
        assert draw(run, axes=figure.subplots(rows, columns)) is figure
        assert len(figure.axes) == panels
    else:
        figure = draw(run)
    boxes = outlines(figure, rendered=not small)
    assert not any(
        one.x0 < other.x1 - 1 and other.x0 < one.x1 - 1 and one.y0 < other.y1 - 1 and other.y0 < one.y1 - 1
        for one, other in itertools.combinations(boxes, 2)
    )
    page = figure.bbox
    assert all(box.x0 >= -1 and box.y0 >= -1 and box.x1 <= page.x1 + 1 and box.y1 <= page.y1 + 1 for box in boxes)
    for axes in figure.axes:
        if axes.get_legend():
            assert axes.get_legend().get_window_extent().y0 >= axes.get_window_extent().y1 - 1


@pytest.mark.parametrize("name", COMPARING)
def test_several_runs_are_named_after_their_difference(name, run, heavy_object):
    draw, panels = FIGURES[name]
    figure = draw(run, heavy_object)
    check_labelled(figure, panels)
    shown = " ".join(texts(figure.axes[0]))
    assert "plant.m_obj 0.5" in shown
    assert "plant.m_obj 1.0" in shown


def test_labels_of_several_runs(run, heavy_object):
    assert texts(plotting.contact_force(run, heavy_object, labels=["light", "heavy"]).axes[0])[:2] == ["light", "heavy"]
    assert texts(plotting.contact_force(run, run).axes[0])[:2] == ["run 1", "run 2"]


def test_several_quantities_of_several_runs_differ_in_dash_and_colour(run, heavy_object):
    figure = plotting.adaptation(run, heavy_object, labels=["light", "heavy"])
    drawn_lines = figure.axes[0].lines
    assert len({line.get_color() for line in drawn_lines}) == 2
    assert len({(line.get_color(), str(line._dash_pattern)) for line in drawn_lines}) == len(drawn_lines) == 10
    assert texts(figure.axes[0])[-2:] == ["light", "heavy"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"trajectories": 0}, "trajectories: must be at least one Trajectory, was none"),
        ({"trajectories": 2, "labels": ["one"]}, "labels: must be 2, one for each trajectory, was 1"),
        ({"trajectories": 1, "robot": "III"}, "robot: must be one of I, II, was III"),
    ],
)
def test_what_cannot_be_drawn(arguments, message, run):
    count = arguments.pop("trajectories")
    with pytest.raises(cm.UserError) as error:
        plotting.torques(*[run] * count, **{"robot": "I"} | arguments)
    assert str(error.value) == message


def test_contact_loss_is_hatched_only_where_it_happens(run):
    pressed = dataclasses.replace(run, constraint_force=np.abs(run.constraint_force) + 1.0)
    whole, start, settled = plotting.contact_force(run).axes
    assert "contact lost" in texts(whole)
    lowest = whole.collections[0].get_paths()[0].vertices[:, 1].min()
    assert lowest == run.constraint_force[:, 0].min() < 0
    assert not any(len(axes.collections) for axes in plotting.contact_force(pressed).axes)
    assert start.get_xlim()[1] < settled.get_xlim()[0] < settled.get_xlim()[1]


def test_references_lie_where_the_paper_wants_them(run):
    desired = [line for line in plotting.platform_paths(run).axes[0].lines if line.get_color() == "0.78"]
    radii = [np.hypot(*line.get_data()) for line in desired]
    np.testing.assert_allclose(radii, np.outer([2.4, 1.0], np.ones(len(radii[0]))), rtol=1e-12)


def test_thinned_lines_keep_every_peak(run):
    long = resampled(run, 20001)
    spike = long.c_hat.copy()
    spike[12345, 0], spike[777, 0] = 50.0, -50.0
    figure = plotting.adaptation(dataclasses.replace(long, controller=long.controller | {"c_hat": spike}))
    t, y = figure.axes[0].lines[0].get_data()
    assert len(t) <= lines.POINTS + 2
    assert (t[y.argmax()], y.max(), t[y.argmin()], y.min()) == (long.t[12345], 50.0, long.t[777], -50.0)
    assert (t[0], t[-1]) == (long.t[0], long.t[-1])
    assert max(len(line.get_xdata()) for axes in plotting.overview(long).axes for line in axes.lines) <= 2002


@pytest.mark.parametrize("samples", [1, 5, 999, 2001, 4003])
def test_extremes_are_in_order_and_few(samples):
    kept = lines.extremes(np.sin(np.arange(samples)), 100)
    assert np.all(np.diff(kept) > 0)
    assert (kept[0], kept[-1]) == (0, samples - 1)
    assert len(kept) <= max(102, min(samples, 100))


def test_lines_differ_without_colour():
    def lightness(k):
        """CIE L* of the k-th colour, 0 to 100."""
        linear = ((np.array(to_rgb(style.pen(k)["color"])) + 0.055) / 1.055) ** 2.4
        return 116 * np.dot((0.2126, 0.7152, 0.0722), linear) ** (1 / 3) - 16

    assert len({str(style.pen(k)["linestyle"]) for k in range(5)}) == 5
    assert abs(lightness(0) - lightness(1)) > 20  # two runs side by side
    assert abs(lightness(0) - lightness(5)) > 10  # the first two lines with the same dashes
    assert all(abs(lightness(k) - lightness(k + 1)) > 5 for k in range(6))


def test_the_users_settings_are_left_alone(run):
    with matplotlib.rc_context({"lines.linewidth": 7.0, "axes.grid": False}):
        before = dict(matplotlib.rcParams)
        plotting.overview(run)
        assert dict(matplotlib.rcParams) == before


def test_saved_figure_is_as_large_as_it_says(rendered, run, tmp_path):
    plotting.save(plotting.adaptation(run), tmp_path / "figure.png", dpi=50)
    header = (tmp_path / "figure.png").read_bytes()[:24]
    assert header[1:4] == b"PNG"
    assert int.from_bytes(header[16:20]) == round(50 * style.WIDTH)
