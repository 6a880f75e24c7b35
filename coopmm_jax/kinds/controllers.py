"""Controllers as kinds: their gains are their numbers, their methods the law, their constants what others ask of them.

The protocol's types are in ``control/controller.py``; ``docs/controllers.md`` shows how to write one.

>>> gain("feedback of the velocity [1/s]", (0.1, 50.0), VELOCITY).more
Gain(bounds=(0.1, 50.0), per='independent velocity', offset=0.0, section='gains', initial=False)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple, TypeVar

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.protocol import MISSING, Attribute, Field, Group, Kind, Method, Quantity
from coopmm_jax.kinds.registry import declare, find, kind_of

Made = TypeVar("Made")

VELOCITY, ESTIMATE, ROW = "independent velocity", "estimate of (20)-(24)", "constraint row"
ESTIMATES = 5
DEFAULT = "robust_adaptive"
# What the entries of a signal belong to; its own names, as a tuple, where none of these fits.
ENTRIES = ("independent", "independent_arm", "bound", "robot", "row")


class Gain(NamedTuple):
    """Everything about a gain but its value, meaning and limits."""

    bounds: tuple[float, float]  # of a search, unless the scenario's [tuning.bounds] says otherwise
    per: str | None  # the thing that each entry of the gain belongs to; None: the gain is one number
    offset: float  # a search is logarithmic in the gain plus this, which is always positive
    section: str  # of the scenario file
    initial: bool  # whether it acts at the start alone, so that it cannot change over time

    def entries(self, velocities: int, rows: int) -> int | None:
        """Number of entries; None where the gain is one number.

        Args:
            velocities: n, the independent ones.
            rows: m, the constraint rows in force.
        """
        return {None: None, VELOCITY: velocities, ESTIMATE: ESTIMATES, ROW: rows}[self.per]


class Signal(NamedTuple):
    """A signal that a run records: what a controller computes at an instant, or a part of its state, by its name."""

    unit: str
    meaning: str
    per: str | tuple[str, ...] | None = None  # one of ``ENTRIES``, or names of the entries; None: it is one number
    label: str = ""  # of an axis of a figure, if not name and unit


def gain(
    meaning: str,
    bounds: tuple[float, float],
    per: str | None = None,
    *,
    at_least: float | None = 0.0,
    above: float | None = None,
    offset: float = 0.0,
    section: str = "gains",
    initial: bool = False,
) -> Quantity:
    """Annotation of a gain: ``K: Annotated[Vector, gain("stiffness [1/s^2]", (1.0, 400.0), VELOCITY)] = (25.0,) * 6``.

    Args:
        meaning: with its unit, for the help text.
        bounds: of a search, which is logarithmic between them.
        per: VELOCITY, ESTIMATE or ROW; None for a single number.
        at_least: what the gain may not be less than.
        above: what it has to exceed, in the place of ``at_least``.
        offset: of the search, see ``Gain``.
        section: of the scenario file; only the robust term's delta_floor is in [law].
        initial: whether it acts at the start alone.
    """
    return Quantity(
        meaning, above, at_least if above is None else None, more=Gain(bounds, per, offset, section, initial)
    )


def force_gain(meaning: str, bounds: tuple[float, float]) -> Quantity:
    """Annotation of a proportional force feedback (m,) [-], which has to exceed -1 (proof of Theorem 3.1)."""
    return gain(meaning, bounds, ROW, above=-1.0, offset=1.0)


def by_module(name: str, *optional: str) -> Callable[[Made], Made]:
    """Give a class the methods of a controller from the functions of a module, imported when one is first called.

    Gains have to be known without JAX, and the law needs it.

    Args:
        name: of the module.
        optional: methods that it has besides those that each controller must have.
    """

    def decorated(made: Made) -> Made:
        for method in _METHODS:
            if not method.optional or method.name in optional:
                setattr(made, method.name, _of_module(name, method.name))
        return made

    return decorated


def _of_module(module: str, method: str) -> Callable[..., Any]:
    def call(self: Any, *arguments: Any) -> Any:
        return getattr(import_module(module), method)(self, *arguments)

    return call


def controller(name: str, field: str = "controller") -> Kind:
    """Controller by name.

    Raises:
        UserError: there is none.
    """
    return find("controller", name, field)


def name_of(gains: Any) -> str:
    """Name of the controller that gains belong to."""
    kind = kind_of(type(gains))
    assert kind is not None
    return kind.name


def gains_of(made: Any) -> dict[str, Gain]:
    """Facts on each gain of a controller, given its class or its gains, by name."""
    kind = kind_of(made if isinstance(made, type) else type(made))
    assert kind is not None
    return {name: field.about.more for name, field in kind.fields.items()}


def initial(made: Any) -> tuple[str, ...]:
    """Gains of a controller that act at the start alone."""
    return tuple(name for name, about in gains_of(made).items() if about.initial)


def tuned(made: Any) -> tuple[str, ...]:
    """Gains that a tuning changes unless the scenario says otherwise."""
    return getattr(made, "tuned", ()) or made._fields


def shown(made: Any) -> tuple[str, ...]:
    """Signals that the overview of a run has room for, two at most."""
    return getattr(made, "shown", ())


def lateral(gains: Any) -> Any:
    """Gain k by which lateral errors decay, at the rate k u_d1^2, a scalar; 0 of a controller without."""
    name = getattr(gains, "lateral", "")
    return getattr(gains, name) if name else 0.0


def signals_of(made: Any) -> Mapping[str, Signal]:
    """Signals of a controller that a run records, by name."""
    return getattr(made, "signals", {})


def _accept(kind: Kind) -> None:
    if not kind.fields:
        raise UserError(kind.label, "a class with at least one gain", "without")
    for name, field in kind.fields.items():
        _accept_gain(f"{kind.label}: {name}", name, field)
    _known(kind, "tuned", kind.fields, "gains")
    _known(kind, "lateral", kind.fields, "gains")
    if (name := kind.made.lateral) and kind.fields[name].about.more.per is not None:
        raise UserError(f"{kind.label}: lateral", "a gain that is one number", name)
    _known(kind, "shown", signals_of(kind.made), "signals")
    for name, signal in signals_of(kind.made).items():
        if not isinstance(signal, Signal) or not (isinstance(signal.per, tuple | None) or signal.per in ENTRIES):
            must = f"a Signal whose entries belong to one of {', '.join(ENTRIES)}, or have names of their own"
            raise UserError(f"{kind.label}: {name}", must, signal)


def _accept_gain(place: str, name: str, field: Field) -> None:
    about = field.about.more
    if about is None:
        form = f'{name}: Annotated[Scalar, gain("meaning [unit]", (low, high))]'
        raise UserError(place, f"annotated as a gain, as {form}", "as another number")
    entries = field.default if isinstance(field.default, tuple) else (field.default,)
    if not entries or any(type(entry) not in (int, float) or entry != entries[0] for entry in entries):
        was = "without" if field.default is MISSING else field.default
        raise UserError(place, "a gain with a default: one number, or a tuple of equal ones", was)
    low, high = about.bounds
    if not -about.offset < low < high:
        raise UserError(place, f"bounds of a search, low and high, above {0.0 - about.offset:g}", list(about.bounds))
    if about.per not in (None, VELOCITY, ESTIMATE, ROW):
        raise UserError(place, f"one per {VELOCITY}, {ESTIMATE} or {ROW}, or alone", about.per)


def _known(kind: Kind, attribute: str, names: Mapping[str, Any], what: str) -> None:
    given = getattr(kind.made, attribute, ())
    for name in filter(None, (given,) if isinstance(given, str) else given):
        if name not in names:
            raise UserError(f"{kind.label}: {attribute}", f"some of its {what} ({', '.join(names)})", name)


_METHODS = (
    Method("start", ("freedom", "zero"), "its state before the first instant, a pytree of numbers", None),
    Method("command", ("seen", "state"), "a Command: what it wants the actuators to do at one instant", None),
    Method("force_feedback", ("state",), "a ForceFeedback: how measured forces change what it asks for", None),
    Method("estimates", ("state",), "its estimates of the uncertainty, numbers (n,)", None, optional=True),
)

declare(
    Group(
        "controller",
        "the control law",
        _METHODS,
        (
            Attribute("tuned", "names of the gains that a tuning changes; without, all of them", tuple, ()),
            Attribute("lateral", "name of the gain k by which lateral errors decay, at the rate k u_d1^2", str, ""),
            Attribute("signals", "what a run records of it: name -> Signal", dict, {}),
            Attribute("shown", "the two signals in the overview of a run", tuple, ()),
        ),
        _accept,
    )
)
