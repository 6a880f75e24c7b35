"""The sections on the controller: the law in force, its gains, what it knows of the plant.

A field's name is its symbol in ``parameters.py``, which also holds the defaults (section IV of the paper). A gain is a
line with ``gain`` here, and one of ``parameters.Gains``.

>>> GainsSection().K_lambda
0.3
>>> GAINS["K_lambda"]
Gain(section='gains', bounds=(0.0, 30.0), per='constraint row', offset=1.0)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple

from pydantic import Field

from coopmm_jax import parameters
from coopmm_jax.errors import UserError
from coopmm_jax.mechanics.robot import JOINTS, ROBOTS
from coopmm_jax.scenario.fields import AboveMinusOne, NotNegative, Pair, PerEntry, Positive, Section, quantity

_gains, _structure = parameters.Gains(), parameters.Structure()

VELOCITIES = ROBOTS * JOINTS  # of both robots; each constraint row makes one of them dependent
ESTIMATES = 5
VELOCITY, ESTIMATE, ROW = "independent velocity", "estimate of (20)-(24)", "constraint row"


class Gain(NamedTuple):
    """Everything about a gain but its value and meaning."""

    section: str  # of the scenario file
    bounds: tuple[float, float]  # of a search, unless the scenario's [tuning.bounds] says otherwise
    per: str | None  # the thing that each entry of the gain belongs to; None: the gain is one number
    offset: float  # a search is logarithmic in the gain plus this, which is always positive

    def entries(self, rows: int) -> int | None:
        """Number of entries with so many constraint rows in force; None where the gain is one number."""
        return {None: None, VELOCITY: VELOCITIES - rows, ESTIMATE: ESTIMATES, ROW: rows}[self.per]


def gain(default: Any, meaning: str, bounds: tuple[float, float], per: str | None = None, offset: float = 0.0) -> Any:
    """Field of a gain.

    Args:
        default: a scalar, or entries (n,) that are alike.
        meaning: with its unit, for the help text.
        bounds: see ``Gain``.
        per: VELOCITY, ESTIMATE or ROW.
        offset: see ``Gain``.
    """
    text, bracket, unit = meaning.partition(" [")
    return Field(
        default[0] if isinstance(default, tuple) else default,
        description=text + (f", one per {per}" if per else "") + bracket + unit,
        json_schema_extra={"bounds": list(bounds), "per": per, "offset": offset},
    )


class LawSection(Section):
    """[law]: which reading of the control law is in force."""

    robust_term: Literal["proof", "printed"] = quantity(_structure.robust_term, "where c_hat stands in (19)")
    u26: Literal["printed", "corrected"] = quantity(_structure.u26, "form of U26 in (19)")
    feedforward: Literal["projected", "full"] = quantity(
        _structure.feedforward, "how U1 + U2 becomes a force, as after (40) or as in (17)"
    )
    delta_floor: NotNegative = gain(_gains.delta_floor, "lower bound of delta(t) in (19) [-]", (1e-4, 1.0))


class GainsSection(Section):
    """[gains]: the design parameters of (12)-(24) and of the force control."""

    K_sigma: PerEntry[NotNegative] = gain(_gains.K_sigma, "feedback of sigma [1/s]", (0.05, 50.0), VELOCITY)
    gamma: PerEntry[NotNegative] = gain(_gains.gamma, "adaptation rates", (1e-3, 10.0), ESTIMATE)
    c_hat0: PerEntry[NotNegative] = gain(_gains.c_hat0, "initial bounds of the uncertainty", (0.01, 100.0), ESTIMATE)
    K_lambda: PerEntry[AboveMinusOne] = gain(_gains.K_lambda, "force feedback [-]", (0.0, 30.0), ROW, offset=1.0)
    K_I: PerEntry[NotNegative] = gain(_gains.K_I, "integral force feedback [1/s]", (0.05, 200.0), ROW)
    K_u: NotNegative = gain(_gains.K_u, "integral part of sigma, arm entries [1/s]", (0.01, 100.0))
    K_a: NotNegative = gain(_gains.K_a, "arm position feedback (13) [1/s]", (0.02, 100.0))
    k0: NotNegative = gain(_gains.k0, "decay of eta (14) [1/s]", (0.05, 500.0))
    k1: NotNegative = gain(_gains.k1, "backstepping gain of s1", (1.0, 2000.0))
    k2: NotNegative = gain(_gains.k2, "backstepping gain of s2", (0.05, 100.0))
    k3: NotNegative = gain(_gains.k3, "backstepping gain of s3", (0.05, 100.0))
    beta: NotNegative = gain(_gains.beta, "bound of Property 2.2 in (19) [-]", (0.01, 100.0))
    lam_min: Positive = gain(
        _gains.lam_min, "lower bound of the reduced inertia's eigenvalues, Property 2.1", (0.01, 100.0)
    )


def _declared(section: str, kind: type[Section]) -> dict[str, Gain]:
    found = {}
    for name, field in kind.model_fields.items():
        about: Any = field.json_schema_extra
        if about is not None:
            found[name] = Gain(section, tuple(about["bounds"]), about["per"], about["offset"])
    return found


GAINS = _declared("gains", GainsSection) | _declared("law", LawSection)


def full_gains(sections: Mapping[str, Any], rows: int) -> parameters.Gains:
    """Gains as a rollout takes them: one number stands for every entry of its list.

    Args:
        sections: of a scenario, by name; read for the gains alone.
        rows: number of constraint rows in force.

    Raises:
        UserError: a list of the wrong length.
    """
    values = {
        name: entries_of(name, getattr(sections[about.section], name), rows, f"{about.section}.{name}")
        for name, about in GAINS.items()
    }
    return parameters.Gains(**values)


def entries_of(name: str, value: Any, rows: int, field: str) -> Any:
    """A gain as a rollout takes it: a number, or a tuple (n,) for which one number may stand.

    Args:
        name: of the gain.
        value: as a scenario has it.
        rows: number of constraint rows in force.
        field: where the scenario has it, for the error.

    Raises:
        UserError: a list of the wrong length.
    """
    about = GAINS[name]
    count = about.entries(rows)
    if count is not None and not isinstance(value, tuple):
        value = (value,) * count
    if count is not None and len(value) != count:
        raise UserError(field, f"one number or a list of {count}, one per {about.per}", f"a list of {len(value)}")
    return value


def gain_tables(gains: parameters.Gains, names: Iterable[str] = parameters.Gains._fields) -> dict[str, dict[str, Any]]:
    """Tables of a scenario file that hold these gains.

    Args:
        gains: of a rollout.
        names: of those to hold.
    """
    tables: dict[str, dict[str, Any]] = {}
    for name in names:
        value = getattr(gains, name)
        plain = [float(entry) for entry in value] if isinstance(value, tuple) else float(value)
        tables.setdefault(GAINS[name].section, {})[name] = plain
    return tables


class NominalSection(Section):
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
