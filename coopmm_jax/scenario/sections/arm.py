"""The section on the arms: pitch links in the place of links 2 and 3 of [plant], and a lift.

>>> ArmSection(l_links=[0.25, 0.2, 0.2], m_links=[0.5, 0.4, 0.3], I_links=[0.5, 0.3, 0.2]).joints
(6, 6)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

from pydantic import model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.mechanics.robot import YAW
from coopmm_jax.parameters import AnyArm, Arm, LiftedArm, LinkInertia
from coopmm_jax.scenario.fields import Flag, Pair, PerLink, Positive, Section, quantity

MOST = 6  # links of an arm
_OF_PLANT = {"l_links": ("l2", "l3"), "m_links": ("m2", "m3"), "I_links": ("I2", "I3")}


class ArmSection(Section):
    """[arm]: what each column carries, where it is not links 2 and 3 of [plant] alone."""

    per_link: ClassVar[tuple[str, ...]] = tuple(_OF_PLANT)

    lift: Pair[Flag] = quantity(False, "the column lifts its links: a joint after the yaw")
    l_links: PerLink[Positive] | None = quantity(
        None, "half length of each pitch link, from the column to the tip; those of links 2 and 3 [m]"
    )
    m_links: PerLink[Positive] | None = quantity(None, "mass of each pitch link; those of links 2 and 3 [kg]")
    I_links: PerLink[Positive] | None = quantity(
        None, "moment of inertia of each about its centre, across the rod; those of links 2 and 3 [kg m^2]"
    )

    @property
    def lifted(self) -> tuple[bool, bool]:
        """True of each robot whose arm has a lift."""
        return _of_robot(self.lift, 0), _of_robot(self.lift, 1)

    @property
    def described(self) -> tuple[bool, bool]:
        """True of each robot whose arm is not the one of [plant]."""
        first, second = (self.l_links is not None or lifted for lifted in self.lifted)
        return first, second

    @property
    def links(self) -> tuple[int, int]:
        """Number of pitch links of each robot."""
        first, second = lists_of(self.l_links or (0.0, 0.0))
        return len(first), len(second)

    @property
    def joints(self) -> tuple[int, int]:
        """Number of velocities u of each robot, two of its platform among them."""
        first, second = (YAW + 1 + lifts + links for lifts, links in zip(self.lifted, self.links, strict=True))
        return first, second

    def arms(self, plant: Mapping[str, Any]) -> tuple[AnyArm | None, AnyArm | None]:
        """Arms of both robots; None of the one of [plant], whose fields are ``plant``."""

        def one(i: int) -> AnyArm | None:
            if not self.described[i]:
                return None
            return (LiftedArm if self.lifted[i] else Arm)(self._of("l_links", i, plant))

        return one(0), one(1)

    def inertias(self, plant: Mapping[str, Any], scale: Any = 1.0, given: Any = None) -> tuple[Any, Any]:
        """Masses and moments of inertia of both arms, ``LinkInertia``; None of the one of [plant].

        Args:
            plant: masses and moments of inertia of [plant], by name, as they are wanted.
            scale: factor on those of the section's own, a scalar.
            given: in their place, by name.
        """

        def one(i: int) -> LinkInertia | None:
            if not self.described[i]:
                return None
            held = {name: lists_of(given[name])[i] for name in LinkInertia._fields if name in (given or {})}
            own = {name: self._of(name, i, plant, scale) for name in LinkInertia._fields if name not in held}
            return LinkInertia(**held, **own)

        return one(0), one(1)

    def _of(self, name: str, i: int, plant: Mapping[str, Any], scale: Any = 1.0) -> tuple[Any, ...]:
        own = getattr(self, name)
        if own is None:
            both = (plant[each] for each in _OF_PLANT[name])
            return tuple(_of_robot(value, i) for value in both)
        return tuple(scale * x for x in lists_of(own)[i])

    @model_validator(mode="after")
    def _lists_go_together(self) -> Self:
        given = {name: getattr(self, name) for name in self.per_link if getattr(self, name) is not None}
        for name in self.per_link if given else ():
            if name not in given:
                raise UserError(name, "given, where another list of the links is", "missing")
        for robot, i in (("I", 0), ("II", 1)) if given else ():
            counts = [len(lists_of(values)[i]) for values in given.values()]
            for name, count in zip(given, counts, strict=True):
                if count != counts[0] or count > MOST:
                    must = f"a list of {f'at most {MOST}' if count > MOST else counts[0]}, one per pitch link"
                    raise UserError(name, f"{must} of robot {robot}", f"a list of {count}")
        return self


def lists_of(value: Any) -> tuple[Any, Any]:
    """Lists of both robots, from one for both or one for each."""
    return value if isinstance(value[0], tuple) else (value, value)


def starting_joints(arm: ArmSection, initial: Any) -> tuple[Any, Any]:
    """Joints after the yaw at the start, lift before pitches, of both robots; None of the arm of [plant].

    Args:
        arm: section of the arms.
        initial: section of the start.
    """

    def one(i: int) -> tuple[Any, ...] | None:
        if not arm.described[i]:
            return None
        pitches = (_of_robot(initial.a2, i), _of_robot(initial.a3, i))[: arm.links[i]]
        if initial.pitch is not None:
            pitches = lists_of(initial.pitch)[i]
        lift = 0.0 if initial.lift is None else _of_robot(initial.lift, i)
        return (*(lift,) * arm.lifted[i], *pitches)

    return one(0), one(1)


def check_joints(arm: ArmSection, rows: tuple[str, ...]) -> None:
    """Check that each arm has a joint after its yaw for each row that it has to meet.

    Raises:
        UserError: it has fewer.
    """
    contacts = sum(name.startswith("contact") for name in rows)
    for i, (robot, needed) in enumerate((("I", contacts), ("II", len(rows) - contacts))):
        joints = arm.links[i] + arm.lifted[i]
        if joints < needed:
            must = f"{needed} links of robot {robot} or more, a lift counting as one, for the rows of [coupling]"
            raise UserError("arm.l_links", must, joints)


def check_lists(arm: ArmSection, given: Mapping[str, Any], lift: Any) -> None:
    """Check that what other sections give for each pitch link has as many numbers as there are.

    Args:
        arm: section of the arms.
        given: lists by dotted name; None as left out.
        lift: of the arms at the start.

    Raises:
        UserError: a list of another length, or one of arms that have none.
    """
    for name, numbers in given.items():
        if numbers is not None and not any(arm.described):
            raise UserError(name, "left out without links or a lift in [arm]", "given")
        for i, robot in enumerate(("I", "II")):
            count = None if numbers is None else len(lists_of(numbers)[i])
            if count is not None and arm.described[i] and count != arm.links[i]:
                must = f"a list of {arm.links[i]}, one per pitch link of robot {robot}"
                raise UserError(name, must, f"a list of {count}")
    if given["initial.pitch"] is None and max(arm.links) > len(("a2", "a3")):
        raise UserError("initial.pitch", "given, one number per link, where an arm has more than two", "missing")
    if lift is not None and not any(arm.lifted):
        raise UserError("initial.lift", "left out of arms without a lift", lift)


def _of_robot(value: Any, i: int) -> Any:
    return value[i] if isinstance(value, tuple) else value
