"""Surfaces of the object: their shapes, what scenario files say of them, and the arc as one of many."""

from types import SimpleNamespace
from typing import NamedTuple

import jax
import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.courses import Swing
from coopmm_jax.kinds.surfaces import Arc, Conic, Plane, Profile
from coopmm_jax.kinds.timings import Rate
from coopmm_jax.mechanics import plant
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.surfaces import shape_of
from coopmm_jax.parameters import Features, Hardware, Parameters, Structure, Surface
from coopmm_jax.scenario.feasible import check_reference
from tests.beside_a_path import CIRCLE, FULL, at_level, parameters
from tests.samples import SHAPES, assert_close, at_surface, joined, positions, vector

EVERY = SHAPES | {"convex circle": Arc(-0.5), "hollow circle": Arc(0.7)}


@pytest.mark.parametrize("name", EVERY)
def test_level_and_points_belong_together(name):
    shape = EVERY[name]
    for n in (-0.4, -0.1, 0.0, 0.2, 0.45):
        assert float(shape.level(shape.along(n), n)) == pytest.approx(0.0, abs=1e-16)
    level, gradient = jax.value_and_grad(lambda x: shape.level(*x))((0.0, 0.0))
    assert (float(level), *map(float, gradient)) == (0.0, -1.0, 0.0)


def test_closed_forms():
    assert float(Conic(1 / 0.7, 1 / 0.7).along(0.3)) == pytest.approx(np.sqrt(0.49 - 0.09) - 0.7, rel=1e-15)
    a, b = 0.3, 0.5  # semi-axes along arm II and across it
    assert float(Conic(a / b**2, 1 / a).along(0.4)) == pytest.approx(a * np.sqrt(1 - 0.16 / 0.25) - a, rel=1e-15)
    assert float(Conic(0.9, 0.0).along(0.4)) == pytest.approx(-0.45 * 0.16, rel=1e-15)
    assert float(Profile((0.4, -0.3)).along(0.5)) == pytest.approx(-(0.1 - 0.0375), rel=1e-15)
    assert float(Plane().along(0.3)) == 0.0


def test_curvature_passes_smoothly_through_the_plane():
    slope = jax.grad(lambda k: Conic(k, k).along(0.3))
    assert float(slope(0.0)) == pytest.approx(-0.045, rel=1e-15)
    assert float(slope(1e-9)) == pytest.approx(-0.045, rel=1e-9)


@pytest.mark.parametrize("shape", [Conic(1 / 0.7, 1 / 0.7), Arc(0.7)], ids=["conic", "arc"])
def test_the_paper_s_arc_as_a_level(shape):
    """The same multipliers and accelerations, with a tip that rubs, as the arc's own formulas give."""
    pair, q = at_surface(None, 3)
    real = Hardware(tip_friction=0.4, slip_speed=0.3)
    structure = Structure(features=Features(tip_friction=True))
    answers = []
    for surface in (Surface(), Surface(shape=shape)):
        model = build_model(Parameters(plant=pair._replace(surface=surface), hardware=real))
        k = plant.plant_kinematics(structure, model, 0.7, positions(q), (0.3, -0.2, 0.5, 0.4, 0.1, -0.3))
        moved = plant.respond(structure, model, 0.7, k, ((1.0, -2.0, 0.5, 3.0, -4.0),) * 2)
        answers.append((joined(k.velocity), joined(moved.full), vector(moved.multipliers)))
    for own, as_level in zip(*answers, strict=True):
        assert_close(as_level, own, 5e-14)


def test_every_surface_has_a_shape():
    assert shape_of(Surface(contact_radius=0.5)) == Conic(2.0, 2.0)
    assert shape_of(Surface(shape=Plane())) == Plane()


def test_scenario_files_choose_a_surface():
    scenario = cm.load_scenario("flat", coupling={"surface": {"kind": "conic", "curvature_n": 1.2}})
    assert scenario.parameters().plant.surface.shape == Conic(1.2, 0.0)
    assert (
        scenario.with_overrides({"coupling.surface.curvature_e": 0.3}).parameters().plant.surface.shape.curvature_e
        == 0.3
    )
    assert scenario.with_overrides({"coupling.surface": "none"}).parameters().plant.surface.shape is None
    profile = scenario.with_overrides({"coupling.surface": {"kind": "profile", "coefficients": [0.1, 0.2]}})
    assert profile.parameters().plant.surface.shape == Profile((0.1, 0.2))


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"kind": "conc"}, r"surface\.kind: must be one of plane, arc, conic, profile \(did you mean conic\?\)"),
        ({"curvature_n": 1.0}, r"surface\.curvature_n: must be a field of surface \"plane\""),
        ({"kind": "conic", "curvature_n": 1.0, "curvature_e": -1.0}, r"curvature_e: must be 0, or of the sign of"),
        ({"kind": "arc", "radius": 0.0}, r"surface\.radius: must be other than 0"),
        ({"kind": "plane", "radius": 1.0}, r"surface\.radius: must be a field of"),
        ({"kind": "conic", "curvature_n": "1"}, r"surface\.curvature_n: must be a number"),
    ],
)
def test_surfaces_that_cannot_be(table, said):
    with pytest.raises(UserError, match=said):
        cm.load_scenario("flat", coupling={"surface": table})


def test_another_surface_needs_a_place_of_the_contact():
    with pytest.raises(UserError, match=r"coupling\.surface: must be left out without \[reference\.path\], was plane"):
        cm.load_scenario("paper", coupling={"surface": {"kind": "plane"}})


class Lifted(NamedTuple):
    """A plane that misses the object by ``by``, and says that it is somewhere else by ``off``."""

    by: float = 0.0
    off: float = 0.0

    def level(self, e, n):
        return self.by - e + 0.0 * n

    def along(self, n):
        return self.off * n


@pytest.mark.parametrize(
    ("surface", "contact", "said"),
    [
        (
            Lifted(0.1),
            0.0,
            r"coupling\.surface: must be of level 0 at the object, .*, was 0\.1, with a gradient of \(-1, 0\)",
        ),
        (
            Lifted(off=0.1),
            0.2,
            r"coupling\.surface: must be of level 0 where along\(n\) says that it is, was 0\.02 m away",
        ),
        (Arc(0.15), 0.2, r"reference\.contact: must be on the object's surface, was beyond its edge at 0 s"),
        (Arc(-0.2), 0.197, r"reference\.contact: must be where arm I meets the surface at a cosine of 0\.2 or more"),
    ],
)
def test_surfaces_that_the_arm_cannot_follow(surface, contact, said):
    numbers = on_the_circle(Conic(), 0.5)
    surface = Surface(shape=surface)
    reference = numbers.reference._replace(surface=surface, contact=contact)
    given = numbers._replace(plant=numbers.plant._replace(surface=surface), reference=reference)
    stand_in = SimpleNamespace(parameters=lambda: given, simulation=SimpleNamespace(duration=1.0))
    with pytest.raises(UserError, match=said):
        check_reference(stand_in)


# general.md B4: surface, place of the contact, z1 z2 z3 a1 a2 a3 of robot I and lambda after 1 s, lambda_n over 20 s.
STUDY = {
    "arc": (
        *(Conic(1 / 0.7, 1 / 0.7), 0.7),
        [0.568824, 2.408953, -0.034897, 1.294500, -0.783266, 1.566531],
        [19.307465, 0.049811, -0.352250, 0.094626],
        (9.75, 20.15),
    ),
    "plane": (
        *(Conic(0.0, 0.0), 0.5),
        [0.569013, 2.409449, -0.036440, 1.378745, -0.762160, 1.524319],
        [19.052774, 0.083487, -0.267568, 0.050920],
        (9.89, 20.02),
    ),
    "convex arc": (
        *(Conic(-2.0, -2.0), 0.3),
        [0.568974, 2.409390, -0.036183, 1.457945, -0.763992, 1.527985],
        [19.280488, 0.037689, -0.020484, 0.000942],
        (9.93, 20.31),
    ),
    "hollow ellipse": (
        *(Conic(1.2, 1 / 0.3), 0.4),
        [0.568953, 2.409267, -0.035882, 1.416545, -0.780543, 1.561086],
        [19.151863, 0.076242, -0.246259, 0.061655],
        None,
    ),
}


def on_the_circle(shape, amplitude):
    """Around the circle from standstill, 0.05 m and 0.05 rad aside, pressing 15 + 5 sin t where the contact swings."""
    contact = Swing(radius=amplitude)
    n = float(contact.value(0.0))
    yaw = float(np.arctan2(float(shape.along(n)) + 0.7, -n))
    start = parameters(CIRCLE, Rate(), ((2.45, 0.0, 0.0, yaw + 0.05), (1.05, 0.0, 0.0, np.pi / 2)), "rail")
    return at_level(start._replace(reference=start.reference._replace(contact=contact)), shape)


@pytest.mark.parametrize("name", STUDY)
def test_figures_of_the_study(name, programs):
    shape, amplitude, position, forces, extremes = STUDY[name]
    run = programs(FULL)(on_the_circle(shape, amplitude))
    assert run.health.status == 0
    np.testing.assert_allclose([x[1000] for x in run.signals.position[0]], position, rtol=0, atol=1e-6)
    np.testing.assert_allclose([x[1000] for x in run.signals.constraint_force], forces, rtol=0, atol=2e-6)
    force = run.signals.constraint_force[0]
    if extremes is not None:
        assert (force.min(), force.max()) == pytest.approx(extremes, abs=5.1e-3)
    late = run.t > 15.0
    n = amplitude * np.sin(-(np.pi / 6) * np.cos(run.t[late]))
    wanted = np.array([np.asarray(jax.vmap(shape.along)(n)), n])
    error = np.linalg.norm(np.array([x[late] for x in run.signals.contact_point]) - wanted, axis=0).max()
    assert 1.3e-3 - 5e-5 < error < 1.6e-3 + 5e-5
