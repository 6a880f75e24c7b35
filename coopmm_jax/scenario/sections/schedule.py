"""The section [schedule] of a scenario: gains that change over time, linearly between knots.

    [schedule]
    times = [0.0, 2.0, 20.0]                               # s
    K_lambda = [1.0, 3.0, 3.0]                             # at each of these times, in the place of [gains] K_lambda
    K_sigma = [[0.5, 0.5, 0.5, 2.0, 2.0, 2.0], 1.0, 1.0]   # each entry on its own, where it is a list

>>> schedule_section("robust_adaptive")(times=(0.0, 2.0), K_lambda=(1.0, 3.0)).schedule(rows=4).values["K_lambda"][1]
(3.0, 3.0, 3.0, 3.0)
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, ClassVar

from pydantic import Field, create_model, model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import DEFAULT, controller, gains_of, initial
from coopmm_jax.parameters import Schedule
from coopmm_jax.scenario.fields import NotNegative, Section, quantity
from coopmm_jax.scenario.sections.controller import LawSection, all_controllers, entries_of, gains_section


class ScheduleSection(Section):
    """[schedule]: gains that change over time, linear between times and constant outside them."""

    path: ClassVar[str] = "schedule"
    controller: ClassVar[str] = DEFAULT
    times: Annotated[tuple[NotNegative, ...], Field(max_length=64)] | None = quantity(None, "of the knots [s]")

    @model_validator(mode="before")
    @classmethod
    def _without_what_is_none(cls, data: Any) -> Any:
        """Let "none" stand for a gain of any controller, so that a schedule can be taken away whatever it is."""
        return {k: v for k, v in data.items() if v != "none"} if isinstance(data, Mapping) else data

    def schedule(self, rows: int) -> Schedule | None:
        """The schedule with so many constraint rows in force; None where all gains are constant.

        Raises:
            UserError: times that do not rise, or knots that are not as many as times or have a wrong length.
        """
        about = gains_of(controller(self.controller).made)
        found = {name: getattr(self, name) for name in _schedulable(self.controller)}
        given = {name: knots for name, knots in found.items() if knots is not None}
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
            name: tuple(entries_of(about[name], knot, rows, f"schedule.{name}[{i}]") for i, knot in enumerate(knots))
            for name, knots in given.items()
        }
        return Schedule(self.times, values)


@functools.cache
def schedule_section(name: str) -> type[Any]:
    """Class of the section [schedule] for the gains of a controller."""
    fields: dict[str, Any] = {gain: _knots(name, gain) for gain in _schedulable(name)}
    made = create_model("ScheduleSection", __base__=ScheduleSection, __doc__=ScheduleSection.__doc__, **fields)
    made.controller = name
    return made


def _schedulable(name: str) -> tuple[str, ...]:
    return _schedulable_of(controller(name).made)


@functools.cache  # a scenario is made hundreds of times while it is loaded, varied and swept
def _schedulable_of(made: type) -> tuple[str, ...]:
    return tuple(gain for gain in gains_of(made) if gain not in initial(made))


def _knots(name: str, gain: str) -> Any:
    made = gains_section(name)
    field = (made if gain in made.model_fields else LawSection).model_fields[gain]
    one = Annotated[field.annotation, *field.metadata]
    return tuple[one, ...] | None, quantity(None, f"{gain} at each of the times")


def schedule_table(schedule: Schedule | None) -> dict[str, Any]:
    """The table [schedule] of a scenario that has this schedule, or none."""
    if schedule is None:
        return dict.fromkeys(("times", *_of_all_controllers()), "none")
    table: dict[str, Any] = {"times": [float(t) for t in schedule.times]}
    for name in _of_all_controllers():
        knots = schedule.values.get(name)
        table[name] = "none" if knots is None else [_plain(knot) for knot in knots]
    return table


def _of_all_controllers() -> list[str]:
    return list(dict.fromkeys(gain for name in all_controllers() for gain in _schedulable(name)))


def _plain(value: Any) -> Any:
    return [float(entry) for entry in value] if isinstance(value, tuple) else float(value)
