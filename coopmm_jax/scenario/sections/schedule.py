"""The section [schedule] of a scenario: gains that change over time, linearly between knots.

    [schedule]
    times = [0.0, 2.0, 20.0]                               # s
    K_lambda = [1.0, 3.0, 3.0]                             # at each of these times, in the place of [gains] K_lambda
    K_sigma = [[0.5, 0.5, 0.5, 2.0, 2.0, 2.0], 1.0, 1.0]   # each entry on its own, where it is a list

>>> ScheduleSection(times=(0.0, 2.0), K_lambda=(1.0, 3.0)).schedule(rows=4).values["K_lambda"][1]
(3.0, 3.0, 3.0, 3.0)
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any

from pydantic import Field, create_model

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import Schedule
from coopmm_jax.scenario.fields import NotNegative, Section, quantity
from coopmm_jax.scenario.sections.controller import GAINS, GainsSection, LawSection, entries_of

INITIAL = "c_hat0"  # acts at the start alone
SCHEDULABLE = tuple(name for name in GAINS if name != INITIAL)


def _knots(name: str) -> Any:
    field = (GainsSection if name in GainsSection.model_fields else LawSection).model_fields[name]
    one = Annotated[field.annotation, *field.metadata]
    return tuple[one, ...] | None, quantity(None, f"{name} at each of the times")


_Knots = create_model("_Knots", __base__=Section, **{name: _knots(name) for name in SCHEDULABLE})


class ScheduleSection(_Knots):
    """[schedule]: gains that change over time, linear between times and constant outside them."""

    times: Annotated[tuple[NotNegative, ...], Field(max_length=64)] | None = quantity(None, "of the knots [s]")

    def schedule(self, rows: int) -> Schedule | None:
        """The schedule with so many constraint rows in force; None where all gains are constant.

        Raises:
            UserError: times that do not rise, or knots that are not as many as times or have a wrong length.
        """
        given = {name: getattr(self, name) for name in SCHEDULABLE if getattr(self, name) is not None}
        if self.times is None:
            if given:
                raise UserError("schedule.times", "given with a schedule of gains", "left out")
            return None
        if len(self.times) < 2 or any(b <= a for a, b in pairwise(self.times)):
            raise UserError("schedule.times", "at least two times, each later than the one before", list(self.times))
        if not given:
            raise UserError("schedule.times", "given with a schedule of gains", "alone")
        for name, knots in given.items():
            if len(knots) != len(self.times):
                must = f"a list of {len(self.times)}, one for each of schedule.times"
                raise UserError(f"schedule.{name}", must, f"a list of {len(knots)}")
        values = {
            name: tuple(entries_of(name, knot, rows, f"schedule.{name}[{i}]") for i, knot in enumerate(knots))
            for name, knots in given.items()
        }
        return Schedule(self.times, values)


def schedule_table(schedule: Schedule | None) -> dict[str, Any]:
    """The table [schedule] of a scenario that has this schedule, or none."""
    if schedule is None:
        return dict.fromkeys(("times", *SCHEDULABLE), "none")
    table: dict[str, Any] = {"times": [float(t) for t in schedule.times]}
    for name in SCHEDULABLE:
        knots = schedule.values.get(name)
        table[name] = "none" if knots is None else [_plain(knot) for knot in knots]
    return table


def _plain(value: Any) -> Any:
    return [float(entry) for entry in value] if isinstance(value, tuple) else float(value)
