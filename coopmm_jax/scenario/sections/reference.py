"""The section [reference]: what the robots should do, on the paper's circles or along any path.

>>> ReferenceSection().reference(Surface()).radius
(2.4, 1.0)
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, SerializeAsAny, model_validator

from coopmm_jax import parameters
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import courses, paths, timings, waypoints  # noqa: F401 - registers its kinds
from coopmm_jax.kinds.paths import OPEN, span
from coopmm_jax.parameters import PathReference, Reference, Surface
from coopmm_jax.scenario.fields import Finite, Pair, Section, quantity
from coopmm_jax.scenario.kind_sections import Chosen, KindSection

_reference, _beside = parameters.Reference(), parameters.PathReference._field_defaults
_ALONG_A_PATH = ("timing", "offset", "contact")  # without a path nothing reads them

_Kind = SerializeAsAny[KindSection] | None
AnyPath = Annotated[_Kind, BeforeValidator(Chosen("path"))]
AnyTiming = Annotated[_Kind, BeforeValidator(Chosen("timing"))]
AnyCourse = Annotated[_Kind, BeforeValidator(Chosen("course"))]


class ReferenceSection(Section):
    """[reference]: desired motion and contact force."""

    rate: Finite = quantity(_reference.rate, "yaw rate u_d1 of both platforms [rad/s]")
    radius: Pair[Finite] = quantity(_reference.radius, "radius z_d2 of the platform's circle [m]")
    arm_centre: Pair[Finite] = quantity(_reference.arm_centre, "a1_d = arm_centre - arm_swing cos(arm_rate t) [rad]")
    arm_swing: Pair[Finite] = quantity(_reference.arm_swing, "amplitude of a1_d [rad]")
    arm_rate: Finite = quantity(_reference.arm_rate, "angular frequency of a1_d [rad/s]")
    contact_force: Finite = quantity(_reference.contact_force, "desired normal contact force, pressing if positive [N]")
    force: AnyCourse = quantity(None, "desired contact force over time, in the place of contact_force [N]")
    height: AnyCourse = quantity(None, "height of the object over time, in the place of coupling.guide_height [m]")
    path: AnyPath = quantity(None, "path of the object, in the place of all fields on circles above")
    timing: AnyTiming = quantity(None, "timing of the path; rate of a closed one, rest_to_rest of an open one")
    offset: Pair[Finite] | None = quantity(None, "of each platform to the right of the path, 0.7 and -0.7 [m]")
    contact: AnyCourse = quantity(None, "place of the contact across the object over time, else its middle [m]")

    @model_validator(mode="after")
    def _nothing_for_a_path_that_is_none(self) -> ReferenceSection:
        for name in _ALONG_A_PATH:
            if self.path is None and getattr(self, name) is not None:
                raise UserError(name, "left out without [reference.path]", "given")
        return self

    def reference(self, surface: Surface) -> Reference | PathReference:
        """Reference of a rollout.

        Args:
            surface: of the object, with lengths in [m].
        """
        force = self.contact_force if self.force is None else self.force.numbers()
        if self.path is None:
            pairs = {name: _both(getattr(self, name)) for name in ("radius", "arm_centre", "arm_swing")}
            values: dict[str, Any] = {"rate": self.rate, "arm_rate": self.arm_rate, "contact_force": force} | pairs
            return Reference(**values)
        return PathReference(
            path=self.path.numbers(),
            timing=self._timing(),
            offset=_beside["offset"] if self.offset is None else _both(self.offset),
            contact=0.0 if self.contact is None else self.contact.numbers(),
            contact_force=force,
            surface=surface,
        )

    def _timing(self) -> Any:
        if self.timing is not None:
            return self.timing.numbers()
        assert self.path is not None
        return timings.RestToRest() if span(self.path.numbers()) == OPEN else timings.Rate()


def _both(value: Any) -> tuple[Any, Any]:
    return value if isinstance(value, tuple) else (value, value)
