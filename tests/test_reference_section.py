"""The section [reference] along paths: scenarios, what is refused, fits of waypoints, CSV files and tables."""

import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.errors import Notice, Remark
from coopmm_jax.kinds.courses import Steps, Table
from coopmm_jax.kinds.paths import Chebyshev, Eight, Ellipse, Fourier, bent_frame
from coopmm_jax.kinds.waypoints import Csv, Waypoints
from coopmm_jax.parameters import PathReference, Rail
from coopmm_jax.runs.beginning import beginning, warn_of_distant_start
from coopmm_jax.scenario.feasible import check_reference
from tests.beside_a_path import ALONG, EIGHT, ELLIPSE, ellipse, scenario

ANGLE = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)


def test_scenario_becomes_the_reference():
    made, expected = scenario().parameters(), ellipse()
    reference = made.reference
    assert isinstance(reference, PathReference)
    assert reference.path == Ellipse()
    assert reference[1:] == expected.reference[1:]
    assert made.plant.guide == Rail(reference.path, reference.timing)
    assert made.start == expected.start


def test_scenario_survives_its_file(tmp_path):
    first = scenario(uncertainty={"reference.path.half_length": {"distribution": "uniform", "low": 1.6, "high": 1.8}})
    file = tmp_path / "own.toml"
    file.write_text(first.to_toml(), encoding="utf-8")
    assert cm.load_scenario(file) == first


@pytest.mark.parametrize("kind", ["waypoints", "csv", "table"])
def test_fits_have_defaults_that_can_be_used(kind, tmp_path):
    """Orders are whole numbers, also where a scenario leaves them out."""
    x, y = 1.7 * np.cos(ANGLE), 1.2 * np.sin(ANGLE)
    np.savetxt(tmp_path / "loop.csv", np.stack([x, y], axis=1), delimiter=",")
    fields = {"waypoints": {"x": x.tolist(), "y": y.tolist()}, "csv": {"file": str(tmp_path / "loop.csv")}, "table": {}}
    place = "force" if kind == "table" else "path"
    made = scenario(reference=ALONG | {place: {"kind": kind} | fields[kind]})
    assert getattr(made.reference, place).order in (9, 12)


@pytest.mark.parametrize("count", range(2, 7))  # one polynomial goes through these
def test_tables_go_through_their_values_however_few(count):
    times = np.linspace(0.0, 10.0, count)
    made = Table.build(tuple(times), tuple(15.0 + np.sin(times)), order=40)
    np.testing.assert_allclose([made.value(t) for t in times], 15.0 + np.sin(times), atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reference.path.kind": "elipse"}, r"reference.path.kind: must be one of .* \(did you mean ellipse\?\)"),
        ({"reference.path.half_width": 0.0}, "reference.path.half_width: must be greater than 0, was 0"),
        ({"reference.path": "none"}, "reference.timing: must be left out without"),
        ({"reference.path": {"kind": "fourier", "xc": [1.0, 0.1]}}, "xc, xs, yc, ys: must be lists of one length"),
        ({"reference.force": {"kind": "steps", "times": [1.0], "levels": [1.0]}}, "levels: must be a list of 2"),
        ({"reference.path": {"kind": "waypoints", "x": [0, 1, 1], "y": [0, 0, 1]}}, "x: must be at least 4 points"),
        ({"reference.path": {"kind": "csv", "file": "/nowhere.csv"}}, "file: must be a CSV file"),
        (
            {"reference.force": {"kind": "steps", "times": [2.0, 1.0], "levels": [1.0, 2.0, 3.0]}},
            "times: must be rising",
        ),
        ({"reference.force": {"kind": "table", "times": [0.0, 1.0, 1e300]}}, "times: must be within 1e"),
        (
            {"reference.path": {"kind": "waypoints", "x": [0, 1, 1, 1e300], "y": [0, 0, 1, 1]}},
            r"x: must be of points within 1e\+06 m of the world's axes, was \(1e\+300, 1\) at point 4",
        ),
    ],
)
def test_sections_that_are_refused(changes, message):
    with pytest.raises(cm.UserError, match=message):
        scenario().with_overrides(changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"reference.offset": [1.1, -0.7]},
            r"reference: must be within the reach of arm I, 0 to 1 m, was 1\.07 m",
        ),
        ({"reference.offset": [0.7, -1.2]}, "within the reach of arm II"),
        (
            {"reference.contact": {"kind": "sine", "amplitude": 0.75}},
            "reference.contact: must be on the object's surface",
        ),
        ({"reference.height": {"kind": "sine", "mean": 1.0, "amplitude": 0.8}}, "within the reach of arm I"),
        ({"reference.path": {"kind": "open", "x": [0.0, 0.0, 1.0], "y": [0.0, 0.0]}}, "a path that moves on"),
        ({"reference.path": {"kind": "open", "x": [0.0, 3.0], "y": [0.0, 0.0]}}, "within the open path's phases"),
        ({"reference.timing": {"kind": "rate", "rate": 1e4}}, "slow enough for"),
        ({"reference.force": {"kind": "sine", "mean": 1e300}}, "N to either side, was up to 1e"),
    ],
)
def test_references_that_cannot_be_followed(changes, message):
    with pytest.raises(cm.UserError, match=message):
        check_reference(scenario().with_overrides(changes))


def test_one_number_fills_a_list_of_any_length():
    made = scenario(reference=ALONG | {"force": {"kind": "steps", "times": 2.0, "levels": [15.0, 20.0]}})
    assert made.reference.force.times == (2.0,)


def test_where_a_reference_begins():
    """Along x, platforms face it at th = -pi/2: I stands 0.7 m to the right, II to the left, arms straight across."""
    ahead = {"kind": "open", "x": [3.0, 3.0], "y": [1.0, 0.0]}
    timing = {"kind": "rest_to_rest"}
    parameters = cm.load_scenario("flat", reference={"path": ahead, "timing": timing, "contact": "none"}).parameters()
    one, two = beginning(parameters)
    right = 0.5 * np.pi
    np.testing.assert_allclose([one[:4], two[:4]], [[0.0, 0.3, -right, right], [0.0, 1.7, -right, right]], atol=1e-12)
    near = parameters._replace(start=(one, two))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_distant_start(near)
    with pytest.warns(
        Notice, match=r"up to 0\.6 m and 0 rad from where .* \(x 0, y 0\.3, th -1\.5708, a1 1\.5708\) and"
    ):
        warn_of_distant_start(near._replace(start=(one._replace(x=0.6), two)))


def test_arm_along_the_surface_is_refused():
    steep = {
        "reference.contact": {"kind": "sine", "mean": 0.3},
        "reference.offset": [0.4, -0.7],
        "coupling.surface": {"kind": "conic", "curvature_n": -8.0},
    }
    with pytest.raises(cm.UserError, match="where arm I meets the surface"):
        check_reference(scenario().with_overrides(steep))


def test_a_straight_path_teaches_too_little():
    line = {"path": {"kind": "open", "x": [0.0, 5.0], "y": [0.0, 0.0]}}
    with pytest.warns(Notice, match="turns too little"):
        check_reference(scenario(reference=line))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_reference(scenario())


def test_a_law_without_k2_is_not_said_to_learn_too_little():
    straight = scenario(reference={"path": {"kind": "open", "x": [0.0, 5.0], "y": [0.0, 0.0]}})
    numbers = straight.parameters()._replace(gains=())  # of another controller
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_reference(SimpleNamespace(parameters=lambda: numbers, simulation=straight.simulation))


def test_paths_in_closed_form():
    """Ellipse and figure of eight are the Fourier paths of the study; curvature of an ellipse at its ends."""
    for phase in (0.0, 0.7, -2.0):
        np.testing.assert_allclose(Ellipse().point(phase), ELLIPSE.point(phase), rtol=0, atol=1e-15)
        np.testing.assert_allclose(Eight().point(phase), EIGHT.point(phase), rtol=0, atol=1e-15)
    for phase, curvature in ((0.0, 1.7 / 1.2**2), (np.pi / 2, 1.2 / 1.7**2)):
        assert float(bent_frame(Ellipse(), phase)[1]) == pytest.approx(curvature, rel=1e-13)
    p = 0.3
    x = 0.1 + 0.2 * p + 0.3 * (2 * p**2 - 1) + 0.4 * (4 * p**3 - 3 * p)
    assert float(Chebyshev((0.1, 0.2, 0.3, 0.4), (0.0, 1.0)).point(p)[0]) == pytest.approx(x, rel=1e-14)


def test_waypoints_on_a_circle_are_fitted_to_it():
    fitted = Waypoints.build(tuple(2.0 * np.cos(ANGLE)), tuple(1.0 + 2.0 * np.sin(ANGLE)), order=3)
    assert isinstance(fitted.curve, Fourier)
    assert fitted.deviation < 1e-3
    for phase in (0.1, 2.0, 5.0):
        assert np.hypot(fitted.point(phase)[0], fitted.point(phase)[1] - 1.0) == pytest.approx(2.0, abs=1e-3)


def test_more_harmonics_fit_better_until_the_tolerance_holds():
    radius = 2.0 + 0.5 * np.cos(3.0 * ANGLE)
    points = tuple(radius * np.cos(ANGLE)), tuple(radius * np.sin(ANGLE))
    found = [Waypoints.build(*points, order=order, tolerance=1.0).deviation for order in (3, 5, 7, 9)]
    assert found == sorted(found, reverse=True)
    assert found[-1] < 1e-3
    with pytest.raises(cm.UserError, match=r"order: must be enough for a deviation of 0.01 m at most"):
        Waypoints.build(*points, order=5)


def test_open_waypoints_from_a_file(tmp_path):
    file = tmp_path / "points.csv"
    x = np.linspace(0.0, 8.0, 9)
    file.write_text("x,y\n" + "".join(f"{a},{0.5 * np.sin(a)}\n" for a in x), encoding="utf-8")
    fitted = Csv.build(str(file), closed=False, order=16)
    assert fitted.span() == (-1.0, 1.0)
    np.testing.assert_allclose(fitted.point(-1.0), (0.0, 0.0), atol=0.01)
    np.testing.assert_allclose(fitted.point(1.0), (8.0, 0.5 * np.sin(8.0)), atol=0.01)


def test_how_well_a_path_fits_its_points_is_told():
    with pytest.warns(Remark, match=r"^reference\.path: its curve is up to [\d.]+ mm away from the spline"):
        check_reference(cm.load_scenario("waypoints"))


def test_a_file_that_has_changed_since_is_noticed(tmp_path):
    """A loaded scenario says what the file had; stores and tuning runs keep that, and so refuse another content."""
    file, other = (tmp_path / f"{name}.csv" for name in "ab")
    for name, size in ((file, 1.0), (other, 2.0)):
        name.write_text("".join(f"{size * np.cos(a)},{size * np.sin(a)}\n" for a in ANGLE), encoding="utf-8")
    loaded = scenario(reference={"path": {"kind": "csv", "file": str(file)}})
    content = loaded.reference.path.content
    assert re.fullmatch(re.escape(str(file)) + " [0-9a-f]{16}", content)
    assert content in loaded.to_toml()
    elsewhere = loaded.with_overrides({"reference.path.file": str(other)})
    assert elsewhere.reference.path.content.startswith(str(other))
    assert float(elsewhere.parameters().reference.path.point(0.0)[0]) == pytest.approx(2.0, abs=1e-3)
    file.write_bytes(other.read_bytes())
    with pytest.raises(cm.UserError, match=r"content: must be left out, or that of the file as it is now"):
        loaded.with_overrides({"reference.offset": [0.7, -0.6]})
    fresh = loaded.with_overrides({"reference.path.content": ""})
    assert float(fresh.parameters().reference.path.point(0.0)[0]) == pytest.approx(2.0, abs=1e-3)
    assert fresh.to_toml() != loaded.to_toml()


def test_courses_in_closed_form():
    steps = Steps((1.0, 2.0), (0.0, 4.0, 2.0), 0.5)
    assert [float(steps.value(t)) for t in (0.0, 1.25, 1.6, 3.0)] == [0.0, 2.0, 4.0, 2.0]
    table = Table.build((0.0, 5.0, 10.0, 20.0), (15.0, 20.0, 10.0, 15.0), order=20)
    assert [float(table.value(t)) for t in (-1.0, 0.0, 5.0, 20.0, 30.0)] == pytest.approx(
        [15, 15, 20, 15, 15], abs=1e-9
    )
