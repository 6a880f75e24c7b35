"""Names for the types that the equations are written in.

>>> velocity: Vector = (1.0, 0.0)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

if TYPE_CHECKING:
    import jax

    Scalar: TypeAlias = float | jax.Array  # a number, or a scalar array inside a traced rollout
    Bool: TypeAlias = bool | jax.Array
else:
    Scalar = Bool = Any  # so that hints can be evaluated without importing JAX

T = TypeVar("T")
Vector: TypeAlias = tuple[Scalar, ...]
Pair: TypeAlias = tuple[T, T]  # one for each robot
PyTree: TypeAlias = Any  # of scalars, unless it says otherwise
