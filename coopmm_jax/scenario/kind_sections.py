"""Sections that describe a kind: ``kind = "ellipse"`` chooses it, the other fields are those that it declares.

A field of a section that holds one kind of a group is declared so, as plugins load after the sections exist:

    PathSection = Annotated[SerializeAsAny[KindSection], BeforeValidator(Chosen("path", "circle"))]

    class ReferenceSection(Section):
        path: PathSection = section("path", "circle")()
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, get_args, get_origin

from pydantic import BeforeValidator, Field, Strict, create_model
from pydantic.fields import FieldInfo

from coopmm_jax.errors import UserError
from coopmm_jax.kinds import protocol, registry
from coopmm_jax.kinds.probe import probe
from coopmm_jax.kinds.protocol import Kind, Quantity
from coopmm_jax.scenario.fields import Finite, Flag, Pair, Section
from coopmm_jax.scenario.validation import validate

_STRICT = (bool, int, str)


class KindSection(Section):
    """Base of the sections that describe kinds; its subclasses are made by ``section``."""

    label: ClassVar[str] = ""  # for errors
    kind: str = ""

    @classmethod
    def about(cls) -> Kind:
        """Kind that the section describes."""
        raise NotImplementedError

    def numbers(self) -> Any:
        """The kind's NamedTuple, with the section's numbers or what its ``build`` makes of them.

        Raises:
            UserError: ``build`` refuses the section.
        """
        kind = self.about()
        values = {name: getattr(self, name) for name in kind.fields}
        if not hasattr(kind.made, protocol.BUILD):
            return kind.made(**{name: _spread(kind, name, value) for name, value in values.items()})
        return _built(self)  # pyright: ignore[reportArgumentType] - what is frozen has a hash

    @classmethod
    def fixed(cls, field: str) -> bool:
        """True if a field is read once at load and cannot vary: an argument of ``build``."""
        kind = cls.about()
        return field in kind.fields and hasattr(kind.made, protocol.BUILD)


def section(group: str, name: str, base: type[KindSection] = KindSection) -> type[Any]:
    """Class of the section that describes a kind.

    Args:
        group: of the kind.
        name: of the kind.
        base: with the fields that all kinds of the group have in common.

    Raises:
        UserError: no such kind, or a field of it that ``base`` has already.
    """
    return _section(registry.find(group, name).made, base)


class Chosen(NamedTuple):
    """Function that turns a table with ``kind`` into the section of that kind, to validate a field with."""

    group: str  # of the kinds that the field can be
    default: str | None = None  # kind of a table that names none; None: it has to
    base: type[KindSection] = KindSection  # as for ``section``

    def __call__(self, value: Any) -> Any:
        """The section of a table.

        Raises:
            UserError: no such kind, or numbers that it cannot have.
        """
        if isinstance(value, KindSection) or not isinstance(value, Mapping):
            return value
        if "kind" not in value and self.default is None:
            raise UserError("kind", f"one of {', '.join(registry.known(self.group))}", "missing")
        kind = registry.find(self.group, value.get("kind", self.default))
        made = _pinned(validate(_section(kind.made, self.base), value))
        check(made)
        return made


def choice_of(info: FieldInfo) -> Chosen | None:
    """Choice among kinds that a field of a section is, or that it is where it is not left out; None for another one."""
    alternatives = (note for each in get_args(info.annotation) for note in getattr(each, "__metadata__", ()))
    validators = (note.func for note in (*info.metadata, *alternatives) if isinstance(note, BeforeValidator))
    return next((function for function in validators if isinstance(function, Chosen)), None)


def check(described: KindSection) -> None:
    """Make a kind's numbers, let it check them, and if it is a plugin's try the methods of its protocol.

    Raises:
        UserError: the kind refuses its numbers, or a method of a plugin's does not do what the group asks.
    """
    numbers, kind = described.numbers(), described.about()
    if hasattr(numbers, protocol.CHECK):
        calling(f"{kind.label}: {protocol.CHECK}", numbers.check)
    if kind.plugin is not None:
        probe(numbers)


def _pinned(described: KindSection) -> KindSection:
    """The section with what it was loaded from, such as the content of a file, among its fields."""
    kind = described.about()
    if not hasattr(kind.made, protocol.PINNED):
        return described
    values = {name: getattr(described, name) for name in kind.fields}
    return described.model_copy(update=calling(f"{kind.label}: {protocol.PINNED}", kind.made.pinned, **values))


def calling(place: str, function: Callable[..., Any], **arguments: Any) -> Any:
    """Result of a function that a kind gives.

    Raises:
        UserError: one that it raises itself, or any other exception of it, in one line.
    """
    try:
        return function(**arguments)
    except UserError:
        raise
    except Exception as error:
        raise UserError(place, "free of errors", f"{type(error).__name__}: {error}") from None


@functools.cache
def _section(made_by: type, base: type[KindSection]) -> type[Any]:
    kind = registry.kind_of(made_by)
    assert kind is not None
    for name in kind.fields:
        if name in base.model_fields:
            taken = ", ".join(base.model_fields)
            raise UserError(f"{kind.label}: {name}", f"named unlike the fields of every {kind.group} ({taken})", name)
    fields: dict[str, Any] = {"kind": (Literal[kind.name], Field(kind.name, description="what it is"))}
    for name, (type_, about, default) in kind.fields.items():
        given = {} if default is protocol.MISSING else {"default": default if type_ is int else _plain(default)}
        fields[name] = (_type(type_, about), Field(description=about.meaning, **given))
    made = create_model(f"{kind.made.__name__}Section", __base__=base, __doc__=inspect.getdoc(kind.made), **fields)
    made.about = classmethod(lambda cls: kind)  # pyright: ignore[reportAttributeAccessIssue]
    made.label = f"a field of {kind.label}"  # pyright: ignore[reportAttributeAccessIssue]
    return made


def _type(plain: Any, about: Quantity) -> Any:
    """Type that pydantic checks a field by."""
    bounds: Any = protocol.bounds_of(about)
    number = Annotated[Finite, Field(**bounds)] if bounds else Finite
    if is_scalar(plain):
        return number
    if is_pair(plain):
        return Pair[number]
    if is_vector(plain):
        return Annotated[tuple[number, ...], Field(min_length=1), BeforeValidator(_listed)]
    if plain is bool:
        return Flag
    return Annotated[plain, Strict(), Field(**bounds)] if plain in _STRICT else plain


def _listed(value: Any) -> Any:
    """A list of one number where the number alone is given, as on the command line."""
    return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


def is_scalar(plain: Any) -> bool:
    """True for the type of one number."""
    return plain is Any or plain is float


def is_vector(plain: Any) -> bool:
    """True for the type of any number of numbers."""
    args = get_args(plain)
    return get_origin(plain) is tuple and len(args) == 2 and args[1] is Ellipsis and is_scalar(args[0])


def is_pair(plain: Any) -> bool:
    """True for the type of one number for each robot."""
    return get_origin(plain) is tuple and len(get_args(plain)) == 2 and all(map(is_scalar, get_args(plain)))


def _plain(default: Any) -> Any:
    """Default as a section has it: whole numbers of a scalar as floats."""
    if isinstance(default, tuple):
        return tuple(map(_plain, default))
    return float(default) if isinstance(default, int) and not isinstance(default, bool) else default


def _spread(kind: Kind, name: str, value: Any) -> Any:
    return (value, value) if is_pair(kind.fields[name].type) and not isinstance(value, tuple) else value


@functools.lru_cache(maxsize=64)
def _built(described: KindSection) -> Any:
    """Result of a kind's ``build`` for a section."""
    kind = described.about()
    values = {name: getattr(described, name) for name in kind.fields}
    numbers = calling(f"{kind.label}: {protocol.BUILD}", kind.made.build, **values)
    if type(numbers) is not kind.made:
        raise UserError(f"{kind.label}: build", f"a function that returns {kind.made.__name__}", type(numbers).__name__)
    return numbers
