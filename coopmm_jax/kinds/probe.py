"""Trial of a kind: whether the methods of its group's protocol give finite numbers of the right shape."""

from __future__ import annotations

import functools
from typing import Any

from coopmm_jax.algebra.later import jax, jnp
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.protocol import Kind, Method
from coopmm_jax.kinds.registry import GROUPS, kind_of


def probe(instance: Any) -> None:
    """Call a kind's methods at the sample arguments of its protocol, in double precision.

    Args:
        instance: of a registered class.

    Raises:
        UserError: a method that raises, returns something of another shape than it should, or numbers not finite.
    """
    try:
        _probe(instance)
    except TypeError:  # numbers that cannot be hashed
        _probe.__wrapped__(instance)


@functools.lru_cache(maxsize=256, typed=True)  # kinds of equal numbers are equal tuples
def _probe(instance: Any) -> None:
    kind = kind_of(type(instance))
    assert kind is not None
    for method in GROUPS[kind.group].methods:
        if hasattr(instance, method.name):
            for arguments in method.samples:
                _try(kind, instance, method, arguments)


def _try(kind: Kind, instance: Any, method: Method, arguments: tuple[Any, ...]) -> None:
    place = f"{kind.label}: {method.name}"
    with jax.enable_x64(True):
        try:
            function = jax.jit(lambda kind, given: getattr(kind, method.name)(*given))
            result = function(instance, arguments)
        except UserError:
            raise
        except Exception as error:
            raise UserError(place, "free of errors", f"{type(error).__name__}: {error}") from None
        _check(place, method, arguments, result)


def _check(place: str, method: Method, arguments: tuple[Any, ...], result: Any) -> None:
    if method.result is None:
        return
    same = jax.tree.structure(result) == jax.tree.structure(method.result)
    if not same or any(jnp.shape(leaf) != () for leaf in jax.tree.leaves(result)):
        must = f"a function that returns {_described(method.result)}: {method.meaning}"
        raise UserError(place, must, _described(result))
    if not all(bool(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(result)):
        at = ", ".join(f"{name} = {value}" for name, value in zip(method.arguments, arguments))
        raise UserError(place, "finite" + (f" at {at}" if at else ""), jax.tree.map(lambda leaf: f"{leaf:g}", result))


def number_of(kind: Kind, method: str, *arguments: Any) -> Any:
    """Number that a method of a kind without fields gives while a rollout is traced, a scalar.

    Args:
        kind: of a plugin.
        method: name of the method.
        arguments: of it.

    Raises:
        UserError: the method raises, or returns something else.
    """
    place = f"{kind.label}: {method}"
    try:
        result = getattr(kind.made(), method)(*arguments)
    except UserError:
        raise
    except Exception as error:
        raise UserError(place, "free of errors", f"{type(error).__name__}: {error}") from None
    if _described(result) != "a number":
        meaning = next(each.meaning for each in GROUPS[kind.group].methods if each.name == method)
        raise UserError(place, f"a function that returns a number: {meaning}", _described(result))
    return jnp.asarray(result, jnp.result_type(float))


def _described(result: Any) -> str:
    """Kind of thing that a function returns, for a message."""
    if isinstance(result, tuple):
        inner = {_described(entry) for entry in result}
        return f"a tuple of {len(result)}" + (f" ({inner.pop()} each)" if len(inner) == 1 else "")
    shape = jnp.shape(result) if hasattr(result, "shape") or isinstance(result, int | float) else None
    if shape == ():
        return "a number"
    return type(result).__name__ if shape is None else f"an array of shape {shape}"
