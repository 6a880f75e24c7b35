"""Text of a sentence, read by recursive descent; known without JAX.

    sentence   = either ["implies" sentence]
    either     = both {"or" both}
    both       = course {"and" course}
    course     = prefix ["until" [window] prefix]
    prefix     = ("not" | ("always" | "eventually") [window]) prefix | comparison
    comparison = sum {("<=" | ">=" | "<" | ">" | "==") sum}
    sum        = product {("+" | "-") product}
    product    = factor {("*" | "/") factor}
    factor     = "-" factor | number | signal | "abs" "(" sentence ")" | "(" sentence ")"
    window     = "[" number "," (number | "inf") "]"
    signal     = name ["[" name "]"]

What stands in parentheses may be a condition or a number; which one is wanted is checked where it is used. Of a product
one factor has to be a number, of a quotient the second.

>>> read("always[1.5, 20] contact_force >= 5").numbers
(1.5, 20.0, 5.0)
>>> read("always contact_force >= torc")
Traceback (most recent call last):
coopmm_jax.errors.UserError: sentence: must be a number or a signal at column 25 (did you mean torque?), was torc
"""

from __future__ import annotations

import difflib
import math
from typing import Any, NoReturn

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.signals import TAKEN
from coopmm_jax.temporal_logic.sentence import (
    Arithmetic,
    Comparison,
    Constant,
    Logic,
    Sentence,
    Signal,
    Temporal,
    signals_of,
)
from coopmm_jax.temporal_logic.signals import SIGNALS
from coopmm_jax.temporal_logic.tokens import Token, refuse, tokens
from coopmm_jax.temporal_logic.weighing import value_of, weighed

LONGEST = 500  # characters of a sentence
_SMALLEST, _LARGEST = 1e-30, 1e30  # size of a number other than 0: margins divided by it stay finite
_DEEPEST = 40  # parentheses and prefixes inside each other
_RELATIONS = {"<=": "<=", ">=": ">=", "<": "<=", ">": ">=", "==": "=="}
_WORDS = frozenset(("always", "eventually", "until", "and", "or", "not", "implies", "abs", "inf"))
TAKEN.update(_WORDS)
_CONDITION, _QUANTITY = "a condition, as contact_force >= 5,", "a number or a signal"


def read(text: Any, field: str = "sentence") -> Sentence:
    """A sentence from its text.

    Args:
        text: of the sentence.
        field: where it is given, for the error.

    Raises:
        UserError: no sentence, with the column of what is wrong and what should stand there.
    """
    if not isinstance(text, str) or not text.strip():
        must = 'a sentence over signals, as "always[0.5, 20] contact_force >= 5"'
        raise UserError(field, must, "empty" if isinstance(text, str) else text)
    if len(text) > LONGEST:
        raise UserError(field, f"a sentence of at most {LONGEST} characters", f"one of {len(text)}")
    return _Reader(text, field).whole()


class _Reader:
    """Position in a text, and the numbers that have been read so far."""

    def __init__(self, text: str, field: str):
        self.text, self.field = text, field
        self.numbers: list[float] = []
        self.labels: list[str | None] = []
        self.next, self.depth = 0, 0
        self.tokens = tokens(text, field)

    def whole(self) -> Sentence:
        """The sentence that is all of the text."""
        start = self.now
        form = self.condition(self.sentence(), start)
        if self.now.kind != "end":
            hint = " (until takes parentheses: (a until b) until c)" if self.now.text == "until" else ""
            self.fail("the end of the sentence, or and, or, implies, until", self.now, hint)
        form, numbers, unit, scale = weighed(form, tuple(self.numbers))
        labels = (*self.labels, *(None,) * (len(numbers) - len(self.labels)))
        return Sentence(self.text.strip(), form, numbers, labels, unit, scale)

    @property
    def now(self) -> Token:
        """Token to be read next."""
        return self.tokens[self.next]

    def fail(self, expected: str, token: Token, hint: str = "") -> NoReturn:
        """Say what should stand where a token stands."""
        refuse(self.field, expected, token, hint)

    def takes(self, *texts: str) -> str | None:
        """Next token's text, gone past, if it is one of some."""
        token = self.now
        if token.kind == "end" or token.text not in texts:
            return None
        self.next += 1
        return token.text

    def expect(self, text: str, expected: str) -> None:
        """Go past a token that has to be there."""
        if self.takes(text) is None:
            self.fail(expected, self.now)

    def condition(self, part: Any, start: Token) -> Any:
        """A part that has to be true or false."""
        if isinstance(part, Comparison | Logic | Temporal):
            return part
        return self.fail(_CONDITION, start)

    def quantity(self, part: Any, start: Token) -> Any:
        """A part that has to be a number."""
        if isinstance(part, Comparison | Logic | Temporal):
            self.fail(_QUANTITY, start)
        return part

    def sentence(self) -> Any:
        """``sentence`` of the grammar; as with all rules below, of whatever type its text has."""
        start = self.now
        part = self._joined(start, "or", lambda: self._joined(self.now, "and", self.course))
        if self.takes("implies"):
            self.condition(part, start)
            after = self.now
            part = Logic("implies", (part, self.condition(self._deeper(self.sentence), after)))
        return part

    def _joined(self, start: Token, word: str, inner: Any) -> Any:
        part = inner()
        while self.takes(word):
            self.condition(part, start)
            after = self.now
            part = Logic(word, (part, self.condition(inner(), after)))
        return part

    def course(self) -> Any:
        """``course`` of the grammar."""
        start = self.now
        part = self.prefix()
        if self.takes("until"):
            self.condition(part, start)
            window, after = self.window(), self.now
            part = Temporal("until", (part, self.condition(self.prefix(), after)), *window)
        return part

    def prefix(self) -> Any:
        """``prefix`` of the grammar."""
        word = self.takes("not", "always", "eventually")
        if word is None:
            return self.comparison()
        begin, end = self.window() if word != "not" else (0, None)
        after = self.now
        part = self.condition(self._deeper(self.prefix), after)
        return Logic(word, (part,)) if word == "not" else Temporal(word, (part,), begin, end)

    def window(self) -> tuple[int, int | None]:
        """Slots of a window; without one it is the rest of the run."""
        if self.takes("[") is None:
            return self._slot(0.0), None
        begin = self._instant("the window's begin, a number of seconds from 0 on,")
        self.expect(",", "a comma between begin and end of the window")
        token = self.now
        end = None if self.takes("inf") else self._instant("the window's end, a number of seconds or inf,")
        self.expect("]", "] after the window")
        if end is not None and end < begin:
            self.fail(f"the window's end, not before its begin {begin:g},", token)
        return self._slot(begin), None if end is None else self._slot(end)

    def _instant(self, expected: str) -> float:
        if self.now.kind != "number":
            self.fail(expected, self.now)
        return self._value()

    def comparison(self) -> Any:
        """``comparison`` of the grammar; a chain is one comparison and another."""
        start = self.now
        left, found = self.sum(), []
        while relation := self.takes(*_RELATIONS):
            middle = self.now
            right = self.sum()
            sides = (self.quantity(left, start), self.quantity(right, middle))
            found.append(Comparison(_RELATIONS[relation], sides))
            if not signals_of(found[-1]):
                self.fail("a comparison with a signal", start)
            start, left = middle, right
        part = found[0] if found else left
        for other in found[1:]:
            part = Logic("and", (part, other))
        return part

    def sum(self) -> Any:
        """``sum`` of the grammar."""
        return self._chain(("+", "-"), self.product)

    def product(self) -> Any:
        """``product`` of the grammar."""
        return self._chain(("*", "/"), self.factor)

    def _chain(self, signs: tuple[str, ...], inner: Any) -> Any:
        start = self.now
        part = inner()
        while sign := self.takes(*signs):
            self.quantity(part, start)
            after = self.now
            other = self.quantity(inner(), after)
            if sign == "/" and (signals_of(other) or value_of(other, self.numbers) == 0.0):
                self.fail("a number other than 0 below a fraction", after)
            if sign == "*" and signals_of(part) and signals_of(other):
                self.fail("a number, since only one factor can have a signal,", after)
            part = Arithmetic(sign, (part, other))
        return part

    def factor(self) -> Any:
        """``factor`` of the grammar."""
        token = self.now
        if self.takes("-"):
            after = self.now
            return Arithmetic("negative", (self.quantity(self._deeper(self.factor), after),))
        if token.kind == "number":
            value = self._value()
            return Constant(self._slot(value, f"{token.text} at column {token.column}"))
        if self.takes("("):
            return self._parenthesis()
        if self.takes("abs"):
            self.expect("(", "( after abs")
            after = self.now
            return Arithmetic("abs", (self.quantity(self._parenthesis(), after),))
        if token.kind == "name" and token.text not in _WORDS:
            return self.signal()
        return self.fail(f"{_QUANTITY}", token)

    def _parenthesis(self) -> Any:
        part = self._deeper(self.sentence)
        self.expect(")", ") or more of the sentence")
        return part

    def signal(self) -> Signal:
        """``signal`` of the grammar."""
        token = self.now
        self.next += 1
        name, entries = token.text, [known for known in SIGNALS if known.startswith(f"{token.text}[")]
        if name in SIGNALS and self.now.text == "[":
            numbered = [f"{name}_{robot}" for robot in (1, 2) if any(s.startswith(f"{name}_{robot}[") for s in SIGNALS)]
            hint = f" (did you mean {' or '.join(numbered)}?)" if numbered else ""
            self.fail(f"no [ after {name}", self.now, hint)
        if entries:
            self.expect("[", f"[ after {name}, as in {entries[0]},")
            token, name = self.now, f"{name}[{self.now.text}]"
            self.next += self.now.kind != "end"
            if name not in SIGNALS:
                inside = ", ".join(known[known.index("[") + 1 : -1] for known in entries)
                self.fail(f"one of {inside}", token)
            self.expect("]", f"] after {name[:-1]}")
        if name not in SIGNALS:
            stems = dict.fromkeys(known.partition("[")[0] for known in SIGNALS)
            close = difflib.get_close_matches(name[:60], stems, n=1)
            self.fail(
                _QUANTITY,
                token,
                f" (did you mean {close[0]}?)" if close else " (coopmm metrics lists signals, --plugin adds some)",
            )
        return Signal(name)

    def _deeper(self, inner: Any) -> Any:
        self.depth += 1
        if self.depth > _DEEPEST:
            self.fail(f"at most {_DEEPEST} parts inside each other", self.now)
        part = inner()
        self.depth -= 1
        return part

    def _value(self) -> float:
        token, value = self.now, float(self.now.text)
        if not math.isfinite(value):
            self.fail("a finite number", token)
        if value and not _SMALLEST <= value <= _LARGEST:
            self.fail(f"0 or from {_SMALLEST:g} to {_LARGEST:g} in size", token)
        self.next += 1
        return value

    def _slot(self, value: float, label: str | None = None) -> int:
        self.numbers.append(value)
        self.labels.append(label)
        return len(self.numbers) - 1
