"""Signals as kinds: the protocol that those of plugins follow, which sentences of [requirements] speak of."""

from __future__ import annotations

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.protocol import Attribute, Group, Kind, Method
from coopmm_jax.kinds.registry import declare, known

TAKEN: set[str] = set()  # what names mean in sentences already: built-in signals and words, told by their modules


def _accept(kind: Kind) -> None:
    if kind.name in TAKEN:
        raise UserError(kind.label, "registered under a name that means nothing in sentences yet", kind.name)


declare(
    Group(
        "signal",
        "a number at each sample, of which sentences of [requirements] speak",
        (Method("value", ("sample",), "of the signal at one sample, a number", 0.0),),
        (
            Attribute("unit", "of the signal, as text", str),
            Attribute("meaning", "of the signal, in a few words", str),
        ),
        _accept,
    )
)


def added() -> dict[str, Kind]:
    """Signals of plugins by name."""
    return known("signal")
