"""Candidates times samples as lanes of one fixed tile, so that no lane's bits depend on how many others there are."""

from __future__ import annotations

import copy
import functools
import threading
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.parameters import Parameters
from coopmm_jax.sweeps.processes import concurrently, slots
from tuning.cost.objective import FAILED, TERMS, Objective

TILE = 32  # lanes: one core is fastest with 32 to 64, and the usual 16 candidates x 4 samples fill two cores
# What differentiates by a sample's numbers takes LLVM minutes to optimise, and is run a few times: without, it compiles
# four times as fast and runs three times as slow.
_UNOPTIMISED: dict[str, Any] = {"xla_backend_optimization_level": 0}
_COMPILING = {kind: threading.Lock() for kind in ("terms", "gradient", "sensitivity")}


class Samples:
    """Parameters of N samples, flattened to one row each (N, leaves)."""

    def __init__(self, parameters: Parameters):
        leaves, self.structure = jax.tree.flatten(parameters)
        self.rows = np.stack([np.asarray(leaf, float) for leaf in leaves], axis=-1)

    def __len__(self) -> int:
        return len(self.rows)

    def extended(self, rows: np.ndarray) -> Samples:
        """These samples, then those of ``rows`` (M, leaves)."""
        both = copy.copy(self)
        both.rows = np.concatenate([self.rows, rows])
        return both


class Evaluated(NamedTuple):
    """Rollouts of C candidates on N samples."""

    terms: np.ndarray  # (C, N, 9) time averages, in the order of TERMS
    completed: np.ndarray  # (C, N)
    survived: np.ndarray  # (C, N) share of the horizon before a failure

    def costs(self, coefficients: np.ndarray) -> np.ndarray:
        """``Objective.cost`` of every rollout (C, N), from weights over scales (9,)."""
        failed = FAILED * (2.0 - self.survived)
        return np.where(self.completed, np.sum(coefficients * self.terms, axis=-1), failed)


def evaluate(objective: Objective, vectors: np.ndarray, samples: Samples) -> Evaluated:
    """Terms of every candidate (C, n) on every sample."""
    return Evaluated(*_run("terms", objective, vectors, samples, np.zeros(len(TERMS))))


def gradients(
    objective: Objective, vectors: np.ndarray, samples: Samples, coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Costs (C, N) and their gradients (C, N, n), by reverse mode.

    ``coefficients`` are (9,), or (C, 9) where every candidate has its own.

    Reverse mode costs 5 to 6 cost evaluations whatever n, forward mode about 1 + 2 n (measured): forward mode would pay
    for two numbers or one, too rarely for a program of its own.
    """
    costs, slopes = _run("gradient", objective, vectors, samples, coefficients)
    return costs, slopes


def compile_gradients(objective: Objective, samples: Samples) -> None:
    """Begin to compile what ``gradients`` runs on samples of this structure, in a thread of its own.

    LLVM spends most of it on one function, on one core: meanwhile another compiles and runs what the search begins
    with. What goes wrong shows when ``gradients`` is called.
    """
    program = ("gradient", objective, samples.structure, samples.rows.shape[1])
    threading.Thread(target=_compiled, args=program, name="compile gradients").start()


def sensitivities(
    objective: Objective, vectors: np.ndarray, samples: Samples, coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Costs (C, N) and their gradients by the samples' own numbers (C, N, leaves), in the order of ``Samples.rows``."""
    costs, slopes = _run("sensitivity", objective, vectors, samples, coefficients)
    return costs, slopes


def _run(
    kind: str, objective: Objective, vectors: np.ndarray, samples: Samples, coefficients: np.ndarray
) -> list[np.ndarray]:
    """Results of every candidate on every sample, each (C, N, ...)."""
    candidates, count = len(vectors), len(samples)
    lanes = candidates * count
    coefficients = np.broadcast_to(coefficients, (candidates, len(TERMS)))
    lane = np.minimum(np.arange(-(-lanes // TILE) * TILE), lanes - 1)  # what pads a tile repeats the last lane
    starts = range(0, len(lane), TILE)
    found: dict[int, Any] = {}

    def compute(_: Any, start: int) -> None:
        candidate, sample = np.divmod(lane[start : start + TILE], count)
        function = _compiled(kind, objective, samples.structure, samples.rows.shape[1])
        with jax.enable_x64(True):
            found[start] = jax.device_get(function(vectors[candidate], samples.rows[sample], coefficients[candidate]))

    for _ in concurrently(compute, starts, slots()):
        pass
    columns = zip(*(found[start] for start in starts), strict=True)
    arrays = [np.concatenate(parts)[:lanes] for parts in columns]
    return [array.reshape(candidates, count, *array.shape[1:]) for array in arrays]


def _compiled(kind: str, objective: Objective, structure: Any, leaves: int) -> Any:
    with _COMPILING[kind], jax.enable_x64(True):  # threads that need the same program share one
        return _program(kind, objective, structure, leaves)


@functools.lru_cache(maxsize=16)
def _program(kind: str, objective: Objective, structure: Any, leaves: int) -> Any:
    def lane(vector: jax.Array, row: jax.Array, coefficients: jax.Array) -> tuple:
        def parameters(row: jax.Array) -> Parameters:
            return jax.tree.unflatten(structure, [row[i] for i in range(leaves)])

        def cost(vector: jax.Array, row: jax.Array) -> Scalar:
            return objective.cost(vector, parameters(row), coefficients, True)

        if kind == "terms":
            terms, completed, survived = objective.evaluate(vector, parameters(row))
            return jnp.stack(terms), completed, survived
        return jax.value_and_grad(cost, {"gradient": 0, "sensitivity": 1}[kind])(vector, row)

    double = functools.partial(jax.ShapeDtypeStruct, dtype=np.float64)
    arguments = double((TILE, objective.space.size)), double((TILE, leaves)), double((TILE, len(TERMS)))
    options = _UNOPTIMISED if kind == "sensitivity" else None
    return jax.jit(jax.vmap(lane)).lower(*arguments).compile(compiler_options=options)
