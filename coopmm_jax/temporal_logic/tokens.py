"""Words, numbers and signs of a sentence's text, each with its column; known without JAX.

>>> [token.text for token in tokens("contact_force >= 5", "keeps_pressing")]
['contact_force', '>=', '5', '']
"""

from __future__ import annotations

import re
from typing import NamedTuple, NoReturn

from coopmm_jax.errors import UserError

_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_TOKEN = re.compile(rf"\s*(?:({_NUMBER})|([A-Za-z_]\w*)|(<=|>=|==|[<>+\-*/()\[\],]))", re.ASCII)


class Token(NamedTuple):
    """One of them, or the end of the text."""

    kind: str  # number, name, sign, end
    text: str
    column: int  # from 1


def tokens(text: str, field: str) -> list[Token]:
    """Tokens of a text, and its end.

    Args:
        text: of the sentence.
        field: where it is given, for the error.

    Raises:
        UserError: a character that begins none, with its column.
    """
    found, at = [], 0
    while match := _TOKEN.match(text, at):
        number, name, sign = match.groups()
        kind = "number" if number else "name" if name else "sign"
        found.append(Token(kind, number or name or sign, match.end() - len(number or name or sign) + 1))
        at = match.end()
    rest = text[at:].lstrip()
    column = len(text) - len(rest) + 1
    if rest:
        refuse(field, "a name, a number or a sign", Token("sign", rest[0], column))
    return [*found, Token("end", "", column)]


def refuse(field: str, expected: str, token: Token, hint: str = "") -> NoReturn:
    """Say what should stand where a token of a field's text stands.

    Raises:
        UserError: always.
    """
    raise UserError(field, f"{expected} at column {token.column}{hint}", token.text or "its end")
