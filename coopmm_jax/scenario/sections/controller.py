"""The sections on the controller: the law in force, its gains, what it knows of the plant.

A field's name is its symbol in ``parameters.py``, which also holds the defaults (section IV of the paper). The
fields of [gains] are those of the controller that [law] chooses.

>>> gains_section("robust_adaptive")().K_lambda
0.3
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, create_model, field_validator

from coopmm_jax import parameters
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import baselines, controllers
from coopmm_jax.kinds.controllers import DEFAULT, ROW, VELOCITY, Gain
from coopmm_jax.kinds.protocol import Field as Described
from coopmm_jax.kinds.protocol import bounds_of
from coopmm_jax.kinds.registry import known
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.mechanics.robot import JOINTS, ROBOTS
from coopmm_jax.scenario.fields import Finite, NotNegative, Pair, PerEntry, PerLink, Positive, Section, quantity

assert baselines  # which registers them
_gains, _structure = Gains(), parameters.Structure()

VELOCITIES = ROBOTS * JOINTS  # of both robots with the paper's arms; each constraint row makes one of them dependent
_ORDER = {  # of the entries of a gain's list
    VELOCITY: ": of robot I u1, u2, yaw and joints that no row takes, then of robot II",
    ROW: ", in the order of coupling.rows",
}


class LawSection(Section):
    """[law]: the controller, and which reading of the paper's law is in force."""

    controller: str = quantity(DEFAULT, "the control law, by name")
    robust_term: Literal["proof", "printed"] = quantity(_structure.robust_term, "where c_hat stands in (19)")
    u26: Literal["printed", "corrected"] = quantity(_structure.u26, "form of U26 in (19)")
    feedforward: Literal["projected", "full"] = quantity(
        _structure.feedforward, "how U1 + U2 becomes a force, as after (40) or as in (17)"
    )
    delta_floor: NotNegative = quantity(_gains.delta_floor, "lower bound of delta(t) in (19) [-]")

    @field_validator("controller", mode="before")
    @classmethod
    def _known_controller(cls, name: Any) -> Any:
        return controllers.controller(name, "").name


class GainsSection(Section):
    """[gains]: the design parameters of the controller; each controller has its own."""

    path: ClassVar[str] = "gains"
    label: ClassVar[str] = ""  # for errors, in the place of the path


@functools.cache
def gains_section(name: str) -> type[Any]:
    """Class of the section [gains] of a controller."""
    kind = controllers.controller(name)
    fields: dict[str, Any] = {
        gain: (_type(about), Field(_default(about), description=_meaning(about)))
        for gain, about in kind.fields.items()
        if about.about.more.section == "gains"
    }
    made = create_model(f"{kind.made.__name__}Section", __base__=GainsSection, **fields)
    made.__doc__ = f"[gains] of {name}: {(kind.made.__doc__ or '').splitlines()[0]}"
    if name != DEFAULT:
        made.label = f'a gain of controller "{name}"'
    return made


def _type(described: Described) -> Any:
    bounds: Any = bounds_of(described.about)
    number = Annotated[Finite, Field(**bounds)]
    return number if described.about.more.per is None else PerEntry[number]


def _default(described: Described) -> float:
    """One number, also for entries that are alike."""
    value = described.default
    return float(value[0] if isinstance(value, tuple) else value)


def _meaning(described: Described) -> str:
    text, bracket, unit = described.about.meaning.partition(" [")
    per = described.about.more.per
    each = f", one per {per}" if per else ""
    return text + each + _ORDER.get(per or "", "") + bracket + unit


def full_gains(sections: Mapping[str, Any], rows: int) -> Any:
    """Gains as a rollout takes them: one number stands for every entry of its list.

    Args:
        sections: of a scenario, by name; read for the controller, its gains and the arms' joints alone.
        rows: number of constraint rows in force.

    Raises:
        UserError: a list of the wrong length.
    """
    made = controllers.controller(sections["law"].controller).made
    values = {}
    for name, about in controllers.gains_of(made).items():
        value = getattr(sections[about.section], name)
        values[name] = entries_of(about, value, rows, f"{about.section}.{name}", sum(sections["arm"].joints))
    return made(**values)


def entries_of(about: Gain, value: Any, rows: int, field: str, velocities: int = VELOCITIES) -> Any:
    """A gain as a rollout takes it: a number, or a tuple (n,) for which one number may stand.

    Args:
        about: the gain.
        value: as a scenario has it.
        rows: number of constraint rows in force.
        field: where the scenario has it, for the error.
        velocities: number of those of both robots, dependent ones among them.

    Raises:
        UserError: a list of the wrong length.
    """
    count = about.entries(velocities - rows, rows)
    if count is not None and not isinstance(value, tuple):
        value = (value,) * count
    if count is not None and len(value) != count:
        raise UserError(field, f"one number or a list of {count}, one per {about.per}", f"a list of {len(value)}")
    return value


def gain_tables(gains: Any, names: Iterable[str] | None = None) -> dict[str, dict[str, Any]]:
    """Tables of a scenario file that hold these gains.

    Args:
        gains: of a rollout.
        names: of those to hold; all if left out.
    """
    about, tables = controllers.gains_of(gains), {}
    for name in gains._fields if names is None else names:
        value = getattr(gains, name)
        plain = [float(entry) for entry in value] if isinstance(value, tuple) else float(value)
        tables.setdefault(about[name].section, {})[name] = plain
    return tables


def all_controllers() -> list[str]:
    """Names of all controllers, those of plugins last."""
    return list(known("controller"))


class NominalSection(Section):
    """[nominal]: the controller's masses and inertias; one left out is the plant's, times ``scale``."""

    per_link: ClassVar[tuple[str, ...]] = ("m_links", "I_links")

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
    m_f: Pair[Positive] | None = quantity(None, "mass of tractor or steered axle [kg]")
    I_f: Pair[Positive] | None = quantity(None, "yaw moment of inertia of tractor or steered axle [kg m^2]")
    I_wf: Pair[Positive] | None = quantity(None, "moment of inertia of one front wheel [kg m^2]")
    m_links: PerLink[Positive] | None = quantity(None, "mass of each pitch link of [arm] [kg]")
    I_links: PerLink[Positive] | None = quantity(None, "moment of inertia of each pitch link of [arm] [kg m^2]")
