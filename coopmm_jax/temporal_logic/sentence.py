"""Sentences over signals: their parts, as ``temporal_logic/grammar.py`` reads them from text; known without JAX.

A sentence has a form, which is compiled, and numbers, which are not: another tolerance needs no other program. Its
robustness says how far it is from being violated: the margin of a comparison, the smaller margin of "and", the larger
one of "or", the smallest of all samples of "always", the largest of "eventually".

>>> signals_of(Comparison(">=", (Signal("contact_force"), Constant(0))))
('contact_force',)
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, TypeAlias


class Constant(NamedTuple):
    """A number."""

    slot: int  # among the sentence's numbers


class Signal(NamedTuple):
    """A signal's value."""

    name: str  # of ``SIGNALS``


class Arithmetic(NamedTuple):
    """A sum, difference, product, quotient, negative or absolute value."""

    operator: str  # + - * / of two operands; "negative" or "abs" of one
    operands: tuple[Any, ...]


class Comparison(NamedTuple):
    """Two numbers of which one has to be the larger, or which have to be equal."""

    relation: str  # <= >= ==
    operands: tuple[Any, ...]
    scale: int | None = None  # slot of what the margin is divided by; None: it keeps its unit


class Logic(NamedTuple):
    """Conditions joined by a word."""

    operator: str  # and, or, implies of two operands; not of one
    operands: tuple[Any, ...]


class Temporal(NamedTuple):
    """Conditions over a window that counts from the instant of which they are asked."""

    operator: str  # always or eventually of one operand; until of two
    operands: tuple[Any, ...]
    begin: int  # slot of the window's begin [s]
    end: int | None  # slot of its end [s]; None: the end of the run


Formula: TypeAlias = Comparison | Logic | Temporal


class Sentence(NamedTuple):
    """A sentence that has been read."""

    text: str
    form: Formula
    numbers: tuple[float, ...]
    labels: tuple[str | None, ...]  # of each number of a comparison, for a reader; None of the others
    unit: str  # of its robustness; "-" where margins in several units are weighed against each other
    scale: float  # what its robustness is divided by if nothing else is given

    def reach(self) -> float:
        """Instant by which every window has begun, if each is looked at from its first instant [s]."""
        return _reach(self.form, self.numbers)


class Numbers(NamedTuple):
    """Numbers of one sentence, which a program takes as arguments."""

    values: Any  # (n,)
    scale: Any  # of its robustness, in its unit


class Sentences(NamedTuple):
    """Sentences of a scenario: what is compiled, and what is not."""

    forms: tuple[tuple[str, Formula], ...] = ()  # (name, form) of each
    numbers: tuple[Numbers, ...] = ()


NO_SENTENCES = Sentences()
# Robustness of a rollout that fails, in units of its scale, and up to twice as much the earlier it fails: less than
# that of any that completes.
FAILED = -1e6


def stand_in(survived: Any) -> Any:
    """Robustness of a rollout that failed, in units of its scale.

    Args:
        survived: share of the horizon before the failure (...,).
    """
    return FAILED * (2.0 - survived)


def walk(part: Any) -> Iterator[Any]:
    """A part of a sentence and all parts inside, in the order of the text."""
    yield part
    for operand in getattr(part, "operands", ()):
        yield from walk(operand)


def signals_of(part: Any) -> tuple[str, ...]:
    """Names of the signals in a part of a sentence, each once."""
    return tuple(dict.fromkeys(each.name for each in walk(part) if isinstance(each, Signal)))


def is_pointwise(part: Any) -> bool:
    """True if a part of a sentence speaks of one instant alone."""
    return not any(isinstance(each, Temporal) for each in walk(part))


def _reach(part: Any, numbers: tuple[float, ...]) -> float:
    inner = max((_reach(each, numbers) for each in getattr(part, "operands", ())), default=0.0)
    return inner + numbers[part.begin] if isinstance(part, Temporal) else inner
