"""Signals as kinds: the protocol that those of plugins follow, which sentences of [requirements] speak of."""

from __future__ import annotations

from coopmm_jax.kinds.registry import Attribute, Group, Kind, Method, declare, known

declare(
    Group(
        "signal",
        "a number at each sample, of which sentences of [requirements] speak",
        (Method("value", ("sample",), "of the signal at one sample, a number", 0.0),),
        (
            Attribute("unit", "of the signal, as text", str),
            Attribute("meaning", "of the signal, in a few words", str),
        ),
    )
)


def added() -> dict[str, Kind]:
    """Signals of plugins by name."""
    return known("signal")
