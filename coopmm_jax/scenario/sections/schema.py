"""The sections of a scenario file: one class per section, one line per field with its unit and default.

A field's name is its symbol in ``parameters.py``, which also holds the defaults (section IV of the paper). "Pair" means
one number for both robots, or a list [robot I, robot II].

>>> Gains().K_lambda
0.3
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Strict, Tag, field_validator, model_validator

from coopmm_jax import parameters
from coopmm_jax.errors import UserError

Number = TypeVar("Number")
Finite = Annotated[float, Strict(), Field(allow_inf_nan=False)]
NotNegative = Annotated[Finite, Field(ge=0)]
Positive = Annotated[Finite, Field(gt=0)]
AboveMinusOne = Annotated[Finite, Field(gt=-1)]
Count = Annotated[int, Strict(), Field(ge=1, lt=2**31)]
Flag = Annotated[bool, Strict()]


MOST_STEPS = 2**31  # what counts them has 32 bits


def _one_or_list(value: Any) -> str:
    return "list" if isinstance(value, list | tuple) else "one"


# Which alternative is meant is decided by looking at the value, so that a bad value gives one error, not one for each.
_One = Annotated[Number, Tag("one")]
Pair = Annotated[
    _One | Annotated[tuple[Number, ...], Field(min_length=2, max_length=2), Tag("list")], Discriminator(_one_or_list)
]
PerChannel = Annotated[  # the five robust terms of (19)
    _One | Annotated[tuple[Number, ...], Field(min_length=5, max_length=5), Tag("list")], Discriminator(_one_or_list)
]
PerEntry = Annotated[_One | Annotated[tuple[Number, ...], Tag("list")], Discriminator(_one_or_list)]

_geometry, _inertia, _surface = parameters.Geometry(), parameters.Inertia(), parameters.Surface()
_gains, _disturbance, _reference = parameters.Gains(), parameters.Disturbance(), parameters.Reference()
_plant, _structure, _start = parameters.Plant(), parameters.Structure(), parameters.Pose(*zip(*parameters.PAPER_START))


def is_whole(ratio: float) -> bool:
    """Whether a ratio of two times [-] is a whole number, 1 at least, but for rounding errors."""
    return math.isfinite(ratio) and round(ratio) >= 1 and math.isclose(ratio, round(ratio), rel_tol=1e-9)


def quantity(default: Any, meaning: str) -> Any:
    """A field with its default, and its meaning and unit for the help text."""
    return Field(default, description=meaning)


class Section(BaseModel):
    """Base of every section: unknown keys are errors, values cannot be changed in place."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _left_out(cls, data: Any) -> Any:
        """Let "none" drop what a base scenario gives for a field that can be left out."""
        if not isinstance(data, Mapping):
            return data
        optional = {name for name, field in cls.model_fields.items() if field.default is None}
        return {name: value for name, value in data.items() if not (name in optional and value == "none")}


class Simulation(Section):
    """[simulation]: horizon, integration step, what is recorded."""

    duration: Positive = quantity(20.0, "simulated time [s]")
    step: Positive = quantity(0.001, "integration step of RK4 [s]")
    record_every: Count = quantity(1, "steps from one recorded sample to the next")
    precision: Literal["float64", "float32"] = quantity("float64", "floating point numbers of the run")
    seed: Annotated[int, Strict(), Field(ge=0, lt=2**32)] = quantity(0, "of everything random in the run")
    stream: Annotated[int, Strict(), Field(ge=0, lt=2**24)] = quantity(0, "of the seed's noise; in a sweep, the sample")

    @model_validator(mode="after")
    def _whole_samples(self) -> Simulation:
        if not self.duration / self.step < MOST_STEPS:
            raise UserError("duration", f"less than {MOST_STEPS} steps of {self.step:g} s", self.duration)
        sample = self.step * self.record_every
        if not is_whole(self.duration / sample):
            raise UserError("duration", f"a whole number of step * record_every ({sample:g} s)", self.duration)
        return self


class Plant(Section):
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


class Coupling(Section):
    """[coupling]: the constraint rows in force and the geometry they act on."""

    rows: tuple[str, ...] = quantity(
        _structure.rows, "constraint rows in force: contact_normal, then contact_height and both guide rows if wanted"
    )
    contact_radius: Positive = quantity(_surface.contact_radius, "radius of the object's concave arc, Rc [m]")
    guide_radius: Positive = quantity(_surface.guide_radius, "radius of the circle that guides the object [m]")
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


class Nominal(Section):
    """[nominal]: the controller's masses and inertias; one left out is the plant's, times ``scale``."""

    scale: Positive = quantity(1.0, "factor on the plant's masses and inertias, object included [-]")
    m_p: Pair[Positive] | None = quantity(None, "mass of the platform [kg]")
    m1: Pair[Positive] | None = quantity(None, "mass of the column [kg]")
    m2: Pair[Positive] | None = quantity(None, "mass of link 2 [kg]")
    m3: Pair[Positive] | None = quantity(None, "mass of link 3 [kg]")
    I_w: Pair[Positive] | None = quantity(None, "moment of inertia of one wheel [kg m^2]")
    I_p: Pair[Positive] | None = quantity(None, "yaw moment of inertia of the platform [kg m^2]")
    I1: Pair[Positive] | None = quantity(None, "yaw moment of inertia of the column [kg m^2]")
    I2: Pair[Positive] | None = quantity(None, "moment of inertia of link 2 [kg m^2]")
    I3: Pair[Positive] | None = quantity(None, "moment of inertia of link 3 [kg m^2]")
    m_obj: NotNegative | None = quantity(None, "point mass of the object [kg]")


class Law(Section):
    """[law]: which reading of the control law is in force."""

    robust_term: Literal["proof", "printed"] = quantity(_structure.robust_term, "where c_hat stands in (19)")
    u26: Literal["printed", "corrected"] = quantity(_structure.u26, "form of U26 in (19)")
    feedforward: Literal["projected", "full"] = quantity(
        _structure.feedforward, "how U1 + U2 becomes a force, as after (40) or as in (17)"
    )
    delta_floor: NotNegative = quantity(_gains.delta_floor, "lower bound of delta(t) in (19) [-]")


class Gains(Section):
    """[gains]: the design parameters of (12)-(24) and of the force control."""

    K_sigma: PerEntry[NotNegative] = quantity(_gains.K_sigma[0], "feedback of sigma, per independent velocity [1/s]")
    gamma: PerChannel[NotNegative] = quantity(_gains.gamma[0], "adaptation rates of (20)-(24)")
    c_hat0: PerChannel[NotNegative] = quantity(_gains.c_hat0[0], "initial estimates of the uncertainty bounds")
    K_lambda: PerEntry[AboveMinusOne] = quantity(_gains.K_lambda[0], "force feedback, one per constraint row [-]")
    K_I: PerEntry[NotNegative] = quantity(_gains.K_I[0], "integral force feedback, one per constraint row [1/s]")
    K_u: NotNegative = quantity(_gains.K_u, "integral part of sigma, arm entries [1/s]")
    K_a: NotNegative = quantity(_gains.K_a, "arm position feedback (13) [1/s]")
    k0: NotNegative = quantity(_gains.k0, "decay of eta (14) [1/s]")
    k1: NotNegative = quantity(_gains.k1, "backstepping gain of s1")
    k2: NotNegative = quantity(_gains.k2, "backstepping gain of s2")
    k3: NotNegative = quantity(_gains.k3, "backstepping gain of s3")
    beta: NotNegative = quantity(_gains.beta, "bound of Property 2.2 in (19) [-]")
    lam_min: Positive = quantity(_gains.lam_min, "lower bound of the reduced inertia's eigenvalues, Property 2.1")


class Disturbance(Section):
    """[disturbance]: torque amplitude * scale * sin(frequency t + phase) against every actuator."""

    wheel: Finite = quantity(_disturbance.wheel, "amplitude on each wheel [N m]")
    joint: Finite = quantity(_disturbance.joint, "amplitude on each arm joint [N m]")
    scale: Finite = quantity(_disturbance.scale, "factor on all amplitudes [-]")
    frequency: Finite = quantity(_disturbance.frequency, "angular frequency [rad/s]")
    phase: Finite = quantity(_disturbance.phase, "phase at t = 0 [rad]")


class Reference(Section):
    """[reference]: desired motion and contact force."""

    rate: Finite = quantity(_reference.rate, "yaw rate u_d1 of both platforms [rad/s]")
    radius: Pair[Finite] = quantity(_reference.radius, "radius z_d2 of the platform's circle [m]")
    arm_centre: Pair[Finite] = quantity(_reference.arm_centre, "a1_d = arm_centre - arm_swing cos(arm_rate t) [rad]")
    arm_swing: Pair[Finite] = quantity(_reference.arm_swing, "amplitude of a1_d [rad]")
    arm_rate: Finite = quantity(_reference.arm_rate, "angular frequency of a1_d [rad/s]")
    contact_force: Finite = quantity(_reference.contact_force, "desired normal contact force, pressing if positive [N]")


class Initial(Section):
    """[initial]: coordinates at t = 0, at rest; a2 and a3 are first guesses that the constraints correct."""

    x: Pair[Finite] = quantity(_start.x, "midpoint of the axle [m]")
    y: Pair[Finite] = quantity(_start.y, "midpoint of the axle [m]")
    th: Pair[Finite] = quantity(_start.th, "angle of the platform [rad]")
    a1: Pair[Finite] = quantity(_start.a1, "yaw of the arm [rad]")
    a2: Pair[Finite] = quantity(_start.a2, "pitch of link 2 from the horizontal [rad]")
    a3: Pair[Finite] = quantity(_start.a3, "pitch of link 3 from link 2 [rad]")
