"""The error and the warning that a user's input can cause, and any message as one line that a terminal can show.

>>> str(UserError("gains.K_lambda", "greater than -1", -2))
'gains.K_lambda: must be greater than -1, was -2'
"""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from typing import Any

LONGEST = 460  # characters of a message
_FIELD, _WAS, _OTHERS = 120, 160, 3  # characters of the field and of the value; further fields that are named

_containers = reprlib.Repr()
_containers.maxlevel, _containers.maxlist, _containers.maxtuple, _containers.maxdict = 3, 10, 10, 6
_containers.maxstring = _containers.maxother = 60


class Notice(UserWarning):
    """Warning about input that is used all the same; the command line prints it as one line."""

    label = "warning"


class Remark(Notice):
    """Notice of what has been made of input, in which nothing is wrong."""

    label = "note"


class UserError(ValueError):
    """Input that cannot be used: which field, what it must be, what it was. Always prints as one line.

    Args:
        field: dotted name of the field, or the command line option, as the user writes it.
        must: completes the sentence "must be ...".
        was: the offending value, or a few words that describe it.
        more: other fields of the same input that are wrong too.
    """

    def __init__(self, field: str, must: str, was: Any, more: Sequence[str] = ()):
        super().__init__(field, must, was, more)
        self.field, self.must, self.was, self.more = field, must, was, tuple(more)

    def __str__(self) -> str:
        named, unnamed = self.more[:_OTHERS], len(self.more) - _OTHERS
        others = f" (wrong too: {', '.join(one_line(name, _FIELD // 2) for name in named)}" if named else ""
        others += (f" and {unnamed} more)" if unnamed > 0 else ")") if named else ""
        field, was = one_line(self.field, _FIELD), one_line(shown(self.was), _WAS) or "empty"
        return one_line(f"{field}: must be {self.must}, was {was}{others}")


def shown(value: Any) -> str:
    """A value as text, however large, deep or strange it is.

    >>> shown([1, [2, [3, [4]]]]), shown(16**5000)
    ('[1, [2, [3, [...]]]]', 'a number of more than 4300 digits')
    """
    try:
        return _containers.repr(value) if isinstance(value, list | tuple | dict | set) else str(value)
    except ValueError:  # Python prints no longer ones
        return "a number of more than 4300 digits"


def one_line(text: str, limit: int = LONGEST) -> str:
    r"""Text as one printable line: what cannot be printed is spelt out, the middle of what is too long is left out.

    >>> one_line("a\n  b\x1b[31m"), one_line("x" * 100, 11)
    ('a b\\x1b[31m', 'xxxxx ... x')
    """
    ends = text if len(text) <= 4 * limit else text[: 2 * limit] + text[-2 * limit :]
    line = "".join(_printable(character) for character in " ".join(ends.split()))
    if len(line) <= limit and ends is text:
        return line
    head = (limit - 5) * 5 // 6
    return f"{line[:head]} ... {line[len(line) - (limit - 5 - head) :]}"


def _printable(character: str) -> str:
    return character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
