"""In which form a rollout carries its values: a buffer for each scalar, or one vector for each pytree of them.

Every scalar that a loop carries is a buffer of its own, whose address the loop's code stores and loads at each stage,
and what the reverse pass keeps of a step is one array for each. As vectors one rollout runs a seventh faster, and a
gradient twice as fast or more, alone as in a batch; a gradient alone compiles in half the time. Only a batch without
gradients is faster on scalars, by a fifth, as a vector's entries then lie apart.

>>> import jax.numpy as jnp
>>> Vectors(float, lambda signals: signals[0]).pack_read((jnp.ones(()), jnp.ones(()))).values.shape
(1,)
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


@jax.tree_util.register_pytree_node_class
class Packed:
    """Values of all leaves along the last axis, and the structure they came from."""

    def __init__(self, values: Any, structure: Any):
        self.values, self.structure = values, structure

    @classmethod
    def of(cls, tree: Any, dtype: Any) -> Packed:
        """Pack a pytree of scalars, each converted to ``dtype``."""
        leaves, structure = jax.tree.flatten(tree)
        values = jnp.stack([jnp.asarray(leaf, dtype) for leaf in leaves]) if leaves else jnp.zeros(0, dtype)
        return cls(values, structure)

    def unpack(self) -> Any:
        """The pytree again, each leaf with the axes that were put before the last one.

        By one split, whose transpose is one concatenation: that of an index would pad each leaf to the whole vector.
        """
        axis, count = self.values.ndim - 1, self.structure.num_leaves
        columns = jax.lax.split(self.values, (1,) * count, axis) if count else ()
        return jax.tree.unflatten(self.structure, [jnp.squeeze(column, axis) for column in columns])

    def tree_flatten(self) -> tuple[tuple[Any], Any]:
        """What JAX traces, and what it compares."""
        return (self.values,), self.structure

    @classmethod
    def tree_unflatten(cls, structure: Any, children: tuple[Any]) -> Packed:
        """The inverse of ``tree_flatten``."""
        return cls(*children, structure)


class Scalars:
    """A loop whose values are pytrees of scalars."""

    def pack(self, tree: Any) -> Any:
        """What the loop carries for ``tree``."""
        return tree

    unpack = pack_each = unpack_each = pack_read = unpack_read = pack

    def field(self, function: Callable, constants: tuple, report: Callable | None = None) -> Callable:
        """(t, state) -> (rates, report) in this form, from (constants, t, state) -> (rates, report) on scalars."""
        return functools.partial(function, constants)


class Vectors:
    """A loop whose values are one vector for each pytree.

    Args:
        dtype: of the vectors. read: signals -> anything; of signals only the scalars are packed that it reads.
    """

    def __init__(self, dtype: Any, read: Callable):
        self.dtype, self.read = dtype, read

    def pack(self, tree: Any) -> Packed:
        """What the loop carries for ``tree``."""
        return Packed.of(tree, self.dtype)

    def unpack(self, packed: Packed) -> Any:
        """The inverse of ``pack``."""
        return packed.unpack()

    def pack_each(self, parts: tuple) -> tuple[Packed, ...]:
        """Parts apart: one vector of all would have a derivative as soon as one of them has."""
        return tuple(map(self.pack, parts))

    def unpack_each(self, parts: tuple[Packed, ...]) -> tuple:
        """The inverse of ``pack_each``."""
        return tuple(map(self.unpack, parts))

    def pack_read(self, signals: Any) -> Packed:
        """Of ``signals`` what will be read; packing the rest would keep XLA from leaving its computation out."""
        leaves, structure = jax.tree.flatten(signals)
        traced = jax.make_jaxpr(lambda *x: self.read(jax.tree.unflatten(structure, x)))(*leaves).jaxpr
        used = {id(v) for v in (*traced.outvars, *(v for equation in traced.eqns for v in equation.invars))}
        kept = [x if id(v) in used else None for x, v in zip(leaves, traced.invars, strict=True)]
        return self.pack(jax.tree.unflatten(structure, kept))

    def unpack_read(self, packed: Packed) -> Any:
        """The signals again, with zeros where nobody looks."""
        zero = jnp.zeros((), self.dtype)
        return jax.tree.map(lambda x: zero if x is None else x, packed.unpack(), is_leaf=lambda x: x is None)

    def field(
        self, function: Callable, constants: tuple[Packed, ...], report: Callable | None = None
    ) -> Callable[[Any, Packed], tuple[Packed, Packed]]:
        """As ``Scalars.field``, on vectors; the report is packed by ``report``, or as the rates are.

        The barrier ties the reading of the constants to the stage: otherwise XLA reads ahead of the loop and carries
        every scalar after all.
        """
        pack_report = report or self.pack

        def on_vectors(t: Any, at: Packed) -> tuple[Packed, Packed]:
            read, t = jax.lax.optimization_barrier((constants, t))
            rates, reported = function(self.unpack_each(read), t, at.unpack())
            return self.pack(rates), pack_report(reported)

        return on_vectors


Form = Scalars | Vectors
