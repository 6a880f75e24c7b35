"""The section on the platforms: their kind, and the front axle of those that have two axles.

>>> PlatformSection(kind="trailer").fronts()[0].wheelbase
0.5
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import Car, Front, FrontInertia, LogPolar, Trailer
from coopmm_jax.scenario.fields import Finite, NotNegative, Pair, Positive, Section, quantity

Kind = Literal["differential", "trailer", "car"]
Chart = Literal["heading", "logpolar"]
_FRONTS: dict[str, tuple[Front, FrontInertia]] = {
    "trailer": (Trailer(), FrontInertia()),
    "car": (Car(), FrontInertia(m_f=1.0, I_f=0.5, I_wf=0.1)),
}


class PlatformSection(Section):
    """[platform]: what carries each arm, and the front axle of a trailer's tractor or of a car."""

    kind: Pair[Kind] = quantity(
        "differential",
        "differential: two driven wheels; trailer: a tractor pulls it; or car; another kind than the base scenario's"
        " drops whatever else its [platform] has",
    )
    wheelbase: Pair[Positive] | None = quantity(None, "front axle ahead of the axle with the arm; 0.5 [m]")
    d_f: Pair[Finite] | None = quantity(None, "centre of tractor or steered axle ahead of it; 0.5, of a car 0 [m]")
    l_f: Pair[NotNegative] | None = quantity(None, "half track of the front wheels; 0.5, of a car 0 [m]")
    r_f: Pair[Positive] | None = quantity(None, "radius of the front wheels; 0.5, of a car 0.25 [m]")
    m_f: Pair[Positive] | None = quantity(None, "mass of tractor or steered axle; 5, of a car 1 [kg]")
    I_f: Pair[Positive] | None = quantity(
        None, "its yaw moment of inertia about its centre, of a car with its steering drive; 2.5, of a car 0.5 [kg m^2]"
    )
    I_wf: Pair[Positive] | None = quantity(
        None, "moment of inertia of one front wheel about its axle; 1, of a car 0.1 [kg m^2]"
    )
    chart: Pair[Chart] | None = quantity(
        None, "chained form from the heading, or logpolar: about the origin, where a platform can also drive straight"
    )
    unit: Pair[Positive] | None = quantity(
        None, "unit of length of the chained form; wheelbase + rho^2/wheelbase at the mean turning radius rho [m]"
    )

    @property
    def kinds(self) -> tuple[str, str]:
        """Kinds of both robots' platforms."""
        first, second = _both(self.kind)
        return first, second

    def fronts(self) -> tuple[Front | None, Front | None]:
        """Front axles of both robots; None of a differential drive."""
        return self._each(0)

    def inertias(self, scale: Any = 1.0, given: Mapping[str, Any] | None = None) -> tuple[Any, Any]:
        """Masses and moments of inertia of both robots' front axles, ``FrontInertia`` or None.

        Args:
            scale: factor on all that is not given, a scalar.
            given: in the place of the section's own, by name; None as much as left out.
        """
        held = {name: value for name, value in (given or {}).items() if value is not None}

        def one(i: int, front: FrontInertia | None) -> FrontInertia | None:
            if front is None:
                return None
            return FrontInertia(*(_both(held[n])[i] if n in held else scale * x for n, x in front._asdict().items()))

        first, second = self._each(1)
        return one(0, first), one(1, second)

    def _each(self, which: int) -> tuple[Any, Any]:
        def one(i: int, kind: str) -> Any:
            if kind == "differential":
                return None
            usual = _FRONTS[kind][which]
            given = {name: getattr(self, name) for name in usual._fields if name != "chart"}
            numbers = {name: _both(value)[i] for name, value in given.items() if value is not None}
            polar = {"chart": LogPolar()} if which == 0 and _both(self.chart)[i] == "logpolar" else {}
            return usual._replace(**numbers, **polar)

        first, second = self.kinds
        return one(0, first), one(1, second)

    @model_validator(mode="after")
    def _front_axles_exist(self) -> Self:
        given = [name for name in type(self).model_fields if name != "kind" and getattr(self, name) is not None]
        if given and set(self.kinds) == {"differential"}:
            raise UserError(given[0], "left out of differential drives", getattr(self, given[0]))
        for front, kind in zip(self.fronts(), self.kinds, strict=True):
            if kind == "trailer" and front is not None and not _positive(front.l_f):
                raise UserError("l_f", "positive of a trailer, whose tractor turns by its wheels", front.l_f)
        if self.unit is not None and "logpolar" in _both(self.chart):
            raise UserError("unit", "left out of the chart logpolar, which has none", self.unit)
        return self


def _both(value: Any) -> tuple[Any, Any]:
    return value if isinstance(value, tuple) else (value, value)


def _positive(value: Any) -> bool:
    return not isinstance(value, float) or value > 0.0
