"""The sections on the robots: their bodies, what couples them, where they start.

A field's name is its symbol in ``parameters.py``, which also holds the defaults (section IV of the paper).

>>> PlantSection().m_p
5.0
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, SerializeAsAny, field_validator

from coopmm_jax import parameters
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.surfaces import SURFACE
from coopmm_jax.scenario.fields import Finite, NotNegative, Pair, PerLink, Positive, Section, quantity
from coopmm_jax.scenario.kind_sections import Chosen, KindSection

_geometry, _inertia, _surface = parameters.Geometry(), parameters.Inertia(), parameters.Surface()
_plant, _rows = parameters.Plant(), parameters.Structure().rows
_start = dict(zip(parameters.Pose._fields, zip(*parameters.PAPER_START)))  # coordinate -> one for each robot


class PlantSection(Section):
    """[plant]: the two simulated robots and the object."""

    d: Pair[Positive] = quantity(_geometry.d, "centre of the platform ahead of the axle [m]")
    l: Pair[Positive] = quantity(_geometry.l, "half track [m]")  # noqa: E741 - the paper's symbol
    r: Pair[Positive] = quantity(_geometry.r, "wheel radius [m]")
    l1: Pair[Positive] = quantity(_geometry.l1, "half height of the column [m]")
    l2: Pair[Positive] = quantity(_geometry.l2, "half length of link 2 [m]")
    l3: Pair[Positive] = quantity(_geometry.l3, "half length of link 3 [m]")
    mount_offset: Pair[Finite] = quantity(_geometry.mount_offset, "arm mount ahead of the axle [m]")
    m_p: Pair[Positive] = quantity(_inertia.m_p, "mass of the platform [kg]")
    m1: Pair[Positive] = quantity(_inertia.m1, "mass of the column [kg]")
    m2: Pair[Positive] = quantity(_inertia.m2, "mass of link 2 [kg]")
    m3: Pair[Positive] = quantity(_inertia.m3, "mass of link 3 [kg]")
    I_w: Pair[Positive] = quantity(_inertia.I_w, "moment of inertia of one wheel about its axle [kg m^2]")
    I_p: Pair[Positive] = quantity(_inertia.I_p, "yaw moment of inertia of the platform about its centre [kg m^2]")
    I1: Pair[Positive] = quantity(_inertia.I1, "yaw moment of inertia of the column [kg m^2]")
    I2: Pair[Positive] = quantity(_inertia.I2, "moment of inertia of link 2 about its centre, across the rod [kg m^2]")
    I3: Pair[Positive] = quantity(_inertia.I3, "moment of inertia of link 3 about its centre, across the rod [kg m^2]")
    m_obj: NotNegative = quantity(_plant.inertia[1].m_obj, "point mass of the object, at the tip of robot II [kg]")
    gravity: NotNegative = quantity(_plant.gravity, "gravitational acceleration [m/s^2]")


AnySurface = Annotated[SerializeAsAny[KindSection], BeforeValidator(Chosen(SURFACE.name))]


class CouplingSection(Section):
    """[coupling]: the constraint rows in force and the geometry they act on."""

    rows: tuple[str, ...] = quantity(
        _rows, "constraint rows in force: contact_normal, then contact_height and both guide rows if wanted"
    )
    contact_radius: Positive = quantity(
        _surface.contact_radius, "radius of the object's concave arc, Rc, where there is no other surface [m]"
    )
    surface: AnySurface | None = quantity(None, "the object's surface, in the place of the arc")
    guide: Literal["rail", "moving"] | None = quantity(
        None, "along [reference.path]: rail to run on (default) or moving; a free object has no guide rows"
    )
    guide_radius: Positive = quantity(
        _surface.guide_radius, "radius of the circle that guides the object, without a path [m]"
    )
    guide_height: Finite = quantity(_surface.guide_height, "height at which the object is guided [m]")

    @field_validator("rows", mode="before")
    @classmethod
    def _one_of_the_sets(cls, rows: Any) -> Any:
        normal, height, *guide = parameters.ALL_ROWS
        sets = ([normal], [normal, height], [normal, *guide], [normal, height, *guide])
        given = [rows] if isinstance(rows, str) else rows
        if not isinstance(given, list | tuple) or list(given) not in sets:
            raise UserError("", "one of " + ", ".join(str(rows) for rows in sets).replace("'", '"'), rows)
        return given


class InitialSection(Section):
    """[initial]: coordinates at t = 0, at rest; a2 and a3 are first guesses that the constraints correct."""

    per_link: ClassVar[tuple[str, ...]] = ("pitch",)

    x: Pair[Finite] = quantity(_start["x"], "midpoint of the axle [m]")
    y: Pair[Finite] = quantity(_start["y"], "midpoint of the axle [m]")
    th: Pair[Finite] = quantity(_start["th"], "angle of the platform, 0 where it faces along the world's y [rad]")
    a1: Pair[Finite] = quantity(_start["a1"], "yaw of the arm, 0 ahead and pi/2 to the left [rad]")
    a2: Pair[Finite] = quantity(_start["a2"], "pitch of link 2 from the horizontal [rad]")
    a3: Pair[Finite] = quantity(_start["a3"], "pitch of link 3 from link 2 [rad]")
    steer: Pair[Finite] | None = quantity(
        None, "angle of the front axle of a platform on two axles; by default that of the desired motion [rad]"
    )
    pitch: PerLink[Finite] | None = quantity(
        None,
        "pitch of each link of [arm] from the one before, in the place of a2 and a3; the last two are guesses [rad]",
    )
    lift: Pair[Finite] | None = quantity(None, "how far the column of [arm] has lifted its links, 0 [m]")
