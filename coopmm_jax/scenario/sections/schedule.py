"""The section [schedule] of a scenario: gains that change over time or along the path, linearly between knots.

    [schedule]
    times = [0.0, 2.0, 20.0]                               # s
    K_lambda = [1.0, 3.0, 3.0]                             # at each of these times, in the place of [gains] K_lambda
    K_sigma = [[0.5, 0.5, 0.5, 2.0, 2.0, 2.0], 1.0, 1.0]   # each entry on its own, where it is a list

With ``phases`` in the place of ``times`` they change with the phase of the desired motion, and repeat themselves round
a closed path and on circles.

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
from coopmm_jax.parameters import PhaseSchedule, Schedule
from coopmm_jax.scenario.fields import Finite, NotNegative, Section, quantity
from coopmm_jax.scenario.sections.controller import VELOCITIES, LawSection, all_controllers, entries_of, gains_section


class ScheduleSection(Section):
    """[schedule]: gains that change, linear between times and constant outside them, or between phases of the path."""

    path: ClassVar[str] = "schedule"
    controller: ClassVar[str] = DEFAULT
    times: Annotated[tuple[NotNegative, ...], Field(max_length=64)] | None = quantity(None, "of the knots [s]")
    phases: Annotated[tuple[Finite, ...], Field(max_length=64)] | None = quantity(
        None, "of the path at the knots, or yaw on circles [rad], in the place of times"
    )

    @model_validator(mode="before")
    @classmethod
    def _without_what_is_none(cls, data: Any) -> Any:
        """Let "none" stand for a gain of any controller, so that a schedule can be taken away whatever it is."""
        return {k: v for k, v in data.items() if v != "none"} if isinstance(data, Mapping) else data

    def schedule(self, rows: int, velocities: int = VELOCITIES) -> Schedule | PhaseSchedule | None:
        """The schedule with so many constraint rows in force; None where all gains are constant.

        Args:
            rows: their number.
            velocities: number of those of both robots, dependent ones among them.

        Raises:
            UserError: places of the knots that do not rise, or knots that are not as many or have a wrong length.
        """
        about = gains_of(controller(self.controller).made)
        found = {name: getattr(self, name) for name in _schedulable(self.controller)}
        given = {name: knots for name, knots in found.items() if knots is not None}
        over, places = self._places()
        if places is None:
            if given:
                raise UserError("schedule.times", "given with a schedule of gains", "left out")
            return None
        if not given:
            raise UserError(f"schedule.{over}", "given with a schedule of gains", "alone")
        for name, knots in given.items():
            if len(knots) != len(places):
                must = f"a list of {len(places)}, one for each of schedule.{over}"
                raise UserError(f"schedule.{name}", must, f"a list of {len(knots)}")
        values = {
            name: tuple(
                entries_of(about[name], knot, rows, f"schedule.{name}.{i}", velocities)
                for i, knot in enumerate(knots, 1)
            )
            for name, knots in given.items()
        }
        return (Schedule if over == "times" else PhaseSchedule)(places, values)

    def _places(self) -> tuple[str, tuple[float, ...] | None]:
        """Places of the knots, and the field that has them."""
        if self.times is not None and self.phases is not None:
            raise UserError("schedule.phases", "left out where schedule.times is given", "given")
        if self.phases is None:
            over, places, later = "times", self.times, "two times, each later"
        else:
            over, places, later = "phases", self.phases, "two phases, each higher"
        if places is not None and (len(places) < 2 or any(b <= a for a, b in pairwise(places))):
            raise UserError(f"schedule.{over}", f"at least {later} than the one before", list(places))
        return over, places


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


def schedule_table(schedule: Schedule | PhaseSchedule | None) -> dict[str, Any]:
    """The table [schedule] of a scenario that has this schedule, or none."""
    table: dict[str, Any] = dict.fromkeys(("times", "phases", *_of_all_controllers()), "none")
    if schedule is None:
        return table
    places, values = schedule
    table["times" if isinstance(schedule, Schedule) else "phases"] = [float(place) for place in places]
    return table | {name: [_plain(knot) for knot in knots] for name, knots in values.items()}


def _of_all_controllers() -> list[str]:
    return list(dict.fromkeys(gain for name in all_controllers() for gain in _schedulable(name)))


def _plain(value: Any) -> Any:
    return [float(entry) for entry in value] if isinstance(value, tuple) else float(value)
