"""Protocols that kinds follow: the fields, methods and constants of a class, and their check when it is registered.

A kind is a NamedTuple class: its fields are the numbers of a rollout, each annotated with its meaning, unit and bounds,
its methods are what the group's protocol asks for. Nothing here imports JAX.

>>> class Round(NamedTuple):
...     top: Annotated[float, quantity("height [m]", above=0)] = 0.1
>>> fields_of(Round, "bump")["top"].about.above
0
"""

from __future__ import annotations

import inspect
import sys
import types
import typing
from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple, get_args, get_origin

from coopmm_jax.errors import UserError

MISSING: Any = inspect.Parameter.empty  # default of a field that has to be given
BUILD = "build"  # class method whose arguments take the place of the kind's own numbers as fields of a section
CHECK = "check"  # method that refuses numbers which do not fit together
PINNED = "pinned"  # class method: fields of a section -> those that say what was read when it was loaded


class Quantity(NamedTuple):
    """Meaning of a number with its unit, and its bounds."""

    meaning: str  # "semi-axis along x [m]"
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    more: Any = None  # what the kind's group wants to know besides


def quantity(
    meaning: str,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
) -> Quantity:
    """Annotation of a kind's field: ``a: Annotated[Scalar, quantity("semi-axis along x [m]", above=0)] = 1.7``.

    Args:
        meaning: with the unit in brackets at its end, for the help text, sweeps and figures.
        above: the number has to be greater.
        at_least: the number has to be this or greater.
        below: the number has to be less.
        at_most: the number has to be this or less.
    """
    return Quantity(meaning, above, at_least, below, at_most)


def bounds_of(about: Quantity) -> dict[str, float]:
    """Bounds of a number, in its own unit [-], as pydantic names them."""
    given = {"gt": about.above, "ge": about.at_least, "lt": about.below, "le": about.at_most}
    return {name: bound for name, bound in given.items() if bound is not None}


class Field(NamedTuple):
    """One field of the section that describes a kind."""

    type: Any  # Scalar, Vector, Pair, or a type that pydantic knows
    about: Quantity
    default: Any  # MISSING where it has to be given


class Method(NamedTuple):
    """A method that a group asks of its kinds."""

    name: str
    arguments: tuple[str, ...]
    meaning: str  # of its result, with unit
    result: Any  # pytree of numbers that has the result's structure; None: not checked
    samples: tuple[tuple[Any, ...], ...] = ()  # arguments to try a kind with when it is first used
    optional: bool = False


class Attribute(NamedTuple):
    """A constant that a group asks of its kinds, written as ``unit = "N"`` in the class, without an annotation."""

    name: str
    meaning: str
    allowed: tuple[Any, ...] | type  # values, or the type of them
    default: Any = MISSING


class Group(NamedTuple):
    """Protocol of the kinds of one group."""

    name: str
    meaning: str
    methods: tuple[Method, ...]
    attributes: tuple[Attribute, ...] = ()
    accept: Callable[[Kind], None] | None = None  # told of every new kind


class Kind(NamedTuple):
    """A registered class."""

    group: str
    name: str
    made: Any  # the NamedTuple class
    fields: Mapping[str, Field]
    plugin: str | None  # where it comes from, as the user named it; None: built in

    @property
    def label(self) -> str:
        """Name for errors, with the plugin that it comes from."""
        plugin = "" if self.plugin is None else f"plugin {self.plugin}: "
        return f'{plugin}{self.group} "{self.name}"'


def check_protocol(group: Group, made: type, label: str) -> None:
    """Refuse a class that is no kind of a group.

    Raises:
        UserError: a method or a constant that is missing or of another form, with the label of the class.
    """
    for method in group.methods:
        function = getattr(made, method.name, None)
        wanted = f"def {method.name}({', '.join(('self', *method.arguments))})"
        if function is None and method.optional:
            continue
        if not callable(function):
            raise UserError(label, f"a class with {wanted}: {method.meaning}", f"without {method.name}")
        if not _takes(function, 1 + len(method.arguments)):
            raise UserError(f"{label}: {method.name}", f"of the form {wanted}", f"{method.name}{_signature(function)}")
    for attribute in group.attributes:
        if not hasattr(made, attribute.name) and attribute.default is not MISSING:
            setattr(made, attribute.name, attribute.default)
        value = getattr(made, attribute.name, MISSING)
        if value is MISSING:
            raise UserError(label, f"a class with {attribute.name} = ...: {attribute.meaning}", "without it")
        allowed = attribute.allowed
        fits = isinstance(value, allowed) if isinstance(allowed, type) else value in allowed
        if not fits:
            named = f"a {allowed.__name__}" if isinstance(allowed, type) else "one of " + ", ".join(map(str, allowed))
            raise UserError(f"{label}: {attribute.name}", f"{named}: {attribute.meaning}", value)


def _takes(function: Callable, count: int) -> bool:
    """True if a function can be called with so many arguments by position."""
    try:
        inspect.signature(function).bind(*range(count))
    except (TypeError, ValueError):
        return False
    return True


def _signature(function: Callable) -> str:
    try:
        return str(inspect.signature(function))
    except (TypeError, ValueError):
        return "(...)"


def fields_of(made: Any, label: str) -> dict[str, Field]:
    """Fields of the section of a kind: its numbers, or the arguments of its ``build``.

    Raises:
        UserError: one without its meaning and unit, with the label of the class.
    """
    build = getattr(made, BUILD, None)
    try:
        hints = _hints(made, build or made)
    except Exception as error:
        must = "annotated with names that can be found where the class is defined"
        raise UserError(label, must, f"{type(error).__name__}: {error}") from None
    if build is None:
        defaults = {name: made._field_defaults.get(name, MISSING) for name in made._fields}
    else:
        arguments = inspect.signature(build).parameters
        defaults = {name: about.default for name, about in arguments.items()}
    return {name: _field(name, hints.get(name), default, label) for name, default in defaults.items()}


def _hints(made: type, owner: Any) -> dict[str, Any]:
    """Annotations of a class or function, but that of a result, which may be the class that is not defined yet."""
    names = {name: hint for name, hint in owner.__annotations__.items() if name != "return"}
    there = vars(sys.modules[made.__module__])
    return typing.get_type_hints(types.SimpleNamespace(__annotations__=names), there, include_extras=True)


def _field(name: str, hint: Any, default: Any, label: str) -> Field:
    if get_origin(hint) is Annotated:
        plain, *notes = get_args(hint)
        about = next((note for note in notes if isinstance(note, Quantity)), None)
        if about is not None:
            return Field(plain, about, default)
    form = f'{name}: Annotated[Scalar, quantity("meaning [unit]")]'
    raise UserError(f"{label}: {name}", f"annotated with its meaning and unit, as {form}", "not")
