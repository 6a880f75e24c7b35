"""Kinds by group and name: what scenario files can choose with ``kind = "..."``, built in or from a plugin.

A kind is a NamedTuple class: its fields are the numbers of a rollout, each annotated with its meaning, unit and bounds,
its methods are what the group's protocol asks for. An instance is a pytree that stands in ``Parameters``; its class is
part of the pytree's structure, so that it selects the code while a rollout is traced. Nothing here imports JAX.

>>> group = declare(Group("bump", "height over distance", (Method("height", ("x",), "height at x", 0.0, ((0.5,),)),)))
>>> @register("bump", "round")
... class Round(NamedTuple):
...     top: Annotated[float, quantity("height [m]", above=0)] = 0.1
...     def height(self, x):
...         return self.top * (1 - x * x)
>>> find("bump", "round").fields["top"].about.above
0
>>> del GROUPS["bump"]
"""

from __future__ import annotations

import contextlib
import difflib
import inspect
import re
import sys
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, NamedTuple, TypeVar, get_args, get_origin

from coopmm_jax.errors import UserError

Registered = TypeVar("Registered")

MISSING: Any = inspect.Parameter.empty  # default of a field that has to be given
BUILD = "build"  # class method whose arguments take the place of the kind's own numbers as fields of a section
CHECK = "check"  # method that refuses numbers which do not fit together
PINNED = "pinned"  # class method: fields of a section -> those that say what was read when it was loaded
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


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


GROUPS: dict[str, Group] = {}
_KINDS: dict[str, dict[str, Kind]] = {}
_loading: list[str] = []  # the plugin that is being loaded


def declare(group: Group) -> Group:
    """Add a group of kinds."""
    GROUPS[group.name] = group
    _KINDS[group.name] = {}
    return group


def register(group: str, name: str) -> Callable[[Registered], Registered]:
    """Register a NamedTuple class as a kind, as a decorator above it: ``@register("path", "ellipse")``.

    Args:
        group: of ``GROUPS``: what the kind is one of.
        name: what a scenario file calls it.

    Raises:
        UserError: no such group, a name that is taken, a field without meaning, or a method that is missing.
    """

    def decorated(made: Registered) -> Registered:
        plugin = _loading[-1] if _loading else None
        place = "kind" if plugin is None else f"plugin {plugin}"
        if group not in GROUPS:
            must = f"registered as one of {', '.join(GROUPS)}{_closest(group, GROUPS)}"
            raise UserError(place, must, group)
        label = f'{place}: {group} "{name}"'
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise UserError(place, f"registered as {group} under a name of letters, digits and _", repr(name))
        if name in _KINDS[group]:
            raise UserError(label, "registered once", "registered twice")
        if not (isinstance(made, type) and issubclass(made, tuple) and hasattr(made, "_fields")):
            raise UserError(label, "a class that inherits from typing.NamedTuple", made)
        _check_protocol(GROUPS[group], made, label)
        kind = Kind(group, name, made, _fields(made, label), plugin)
        _KINDS[group][name] = kind
        accept = GROUPS[group].accept
        if accept is not None:
            accept(kind)
        return made  # pyright: ignore[reportReturnType] - what has been narrowed is still the class that was given

    return decorated


def register_constants(group: str, name: str, about: str, **constants: Any) -> None:
    """Register a kind without numbers, of which there are many alike.

    Args:
        group: of ``GROUPS``.
        name: of the kind.
        about: its docstring.
        constants: attributes and methods by name.
    """
    made: Any = NamedTuple("Constants", [])
    made.__doc__, made.__module__ = about, __name__
    for attribute, value in constants.items():
        setattr(made, attribute, value)
    register(group, name)(made)


def known(group: str) -> dict[str, Kind]:
    """Kinds of a group by name."""
    return _KINDS[group]


def find(group: str, name: Any, field: str = "kind") -> Kind:
    """One kind of a group.

    Args:
        group: of ``GROUPS``.
        name: of the kind, as the user gives it.
        field: where it is given, for the error.

    Raises:
        UserError: no kind of this name.
    """
    kinds = _KINDS[group]
    if not isinstance(name, str) or name not in kinds:
        close = _closest(name, kinds) if isinstance(name, str) else ""
        raise UserError(field, f"one of {', '.join(kinds)}{close}, or of a --plugin", name)
    return kinds[name]


def kind_of(made: type) -> Kind | None:
    """Kind that a class is registered as, if it is."""
    for kinds in _KINDS.values():
        for kind in kinds.values():
            if kind.made is made:
                return kind
    return None


@contextlib.contextmanager
def registering(plugin: str) -> Iterator[None]:
    """Let every kind registered inside belong to a plugin; none stays if the block ends with an exception."""
    before = {group: dict(kinds) for group, kinds in _KINDS.items()}
    _loading.append(plugin)
    try:
        yield
    except BaseException:
        _restore(before)
        raise
    finally:
        _loading.pop()


def _restore(before: Mapping[str, Mapping[str, Kind]]) -> None:
    for group, kinds in _KINDS.items():
        for name in [name for name in kinds if name not in before.get(group, {})]:
            del kinds[name]


def _check_protocol(group: Group, made: type, label: str) -> None:
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


def _fields(made: Any, label: str) -> dict[str, Field]:
    """Fields of the section of a kind: its numbers, or the arguments of its ``build``."""
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


def _closest(name: str, names: Any) -> str:
    matches = difflib.get_close_matches(name, list(names), n=1) if len(name) <= 60 else []
    return f" (did you mean {matches[0]}?)" if matches else ""
