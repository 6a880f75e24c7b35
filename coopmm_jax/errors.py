"""The one error a user's input can cause.

>>> str(UserError("gains.K_lambda", "greater than -1", -2))
'gains.K_lambda: must be greater than -1, was -2'
"""

from __future__ import annotations

from typing import Any


class UserError(ValueError):
    """Input that cannot be used: which field, what it must be, what it was. Always prints as one line.

    Args:
        field: dotted name of the field, or the command line option, as the user writes it.
        must: completes the sentence "must be ...".
        was: the offending value, or a few words that describe it.
        more: how many further errors the same input has.
    """

    def __init__(self, field: str, must: str, was: Any, more: int = 0):
        super().__init__(field, must, was, more)
        self.field, self.must, self.was, self.more = field, must, was, more

    def __str__(self) -> str:
        others = f" (and {self.more} more)" if self.more else ""
        return " ".join(f"{self.field}: must be {self.must}, was {self.was}{others}".split())
