"""Costs, terms and gradients of candidates on samples, one batch element for each pair."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.parameters import Parameters
from coopmm_jax.sweeps.batch import Device, Program, in_batches, prepare, run, slots
from coopmm_jax.sweeps.engine import naming
from tuning.cost.objective import FAILED, TERMS, Objective, check_finite

BATCH = 32  # elements: one core is fastest with 32 to 64, and the usual 16 candidates x 4 samples fill two cores
# Of gradients by gains, of which a descent asks for 4 at a time: a batch of 4 takes 0.7 s of CPU on ``sensed`` over
# 20 s, one of 8 takes 1.5 s and compiles in 57 s, one of 32 takes 2.2 s and compiles in 258 s.
FEW = 4
# What differentiates by a sample's numbers takes LLVM minutes to optimise, and is run a few times: without, it compiles
# four times as fast and runs three times as slow.
_UNOPTIMISED = (("xla_backend_optimization_level", 0),)


class Layout(NamedTuple):
    """Static description of samples: how numbers become parameters, and which of them all samples share."""

    structure: Any  # of the parameters, a PyTreeDef
    shared: tuple[bool, ...]  # (leaves,)

    def split(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of each sample that are its own (N, k), and those that all share, of rows (N, leaves)."""
        shared = np.array(self.shared, bool)
        return rows[:, ~shared], rows[0, shared]

    def parameters(self, own: jax.Array, common: jax.Array) -> Parameters:
        """Parameters of one sample from its own numbers (k,) and those that all share (leaves - k,)."""
        columns = iter(range(len(own))), iter(range(len(common)))
        leaves = [(own, common)[alike][next(columns[alike])] for alike in self.shared]
        return jax.tree.unflatten(self.structure, leaves)

    def all_own(self) -> Layout:
        """The same, with nothing shared: what is differentiated by every number."""
        return self._replace(shared=(False,) * len(self.shared))


class Samples:
    """Parameters of N samples, flattened to one row each (N, leaves).

    Leaves of shape () are numbers that all samples share: of a path that does not vary, which is then computed once for
    a batch.
    """

    def __init__(self, parameters: Parameters):
        leaves, self.structure = jax.tree.flatten(parameters)
        count = max(np.shape(leaf) for leaf in leaves)
        self.rows = np.stack([np.broadcast_to(np.asarray(leaf, float), count) for leaf in leaves], axis=-1)
        self.layout = Layout(self.structure, tuple(np.shape(leaf) == () for leaf in leaves))

    def parameters(self, rows: np.ndarray) -> Parameters:
        """Parameters of the samples ``rows`` (B,), every leaf (B,), but shared ones ()."""
        drawn = self.rows[rows]
        leaves = [drawn[0, i] if alike else drawn[:, i] for i, alike in enumerate(self.layout.shared)]
        return jax.tree.unflatten(self.structure, leaves)

    def __len__(self) -> int:
        return len(self.rows)

    def beside(self, others: Samples) -> Samples:
        """The same, with what ``others`` share shared and nothing else: one program then serves both."""
        same = copy.copy(self)
        same.layout = self.layout._replace(shared=others.layout.shared)
        return same

    def extended(self, rows: np.ndarray) -> Samples:
        """These samples, then those of ``rows`` (M, leaves)."""
        both = copy.copy(self)
        both.rows = np.concatenate([self.rows, rows])
        return both


class Kind(NamedTuple):
    """Function of one candidate on one sample, and how batches of it are run."""

    function: Callable[..., Any]  # (objective, layout, vector, own, coefficients, common), at the top of a module
    size: int = BATCH  # of a batch
    by_sample: bool = False  # whether it differentiates by all numbers of a sample

    def layout(self, samples: Samples) -> Layout:
        """Layout of the samples that it takes."""
        return samples.layout.all_own() if self.by_sample else samples.layout

    def program(self, objective: Any, layout: Layout) -> Program:
        """Program that is compiled for an objective."""
        return Program(self.function, (objective, layout), _UNOPTIMISED if self.by_sample else ())


class Evaluated(NamedTuple):
    """Rollouts of C candidates on N samples."""

    terms: np.ndarray  # (C, N, 9) time averages, in the order of TERMS
    completed: np.ndarray  # (C, N)
    survived: np.ndarray  # (C, N) share of the horizon before a failure

    def costs(self, coefficients: np.ndarray) -> np.ndarray:
        """``Objective.cost`` of every rollout (C, N), from weights over scales (9,)."""
        failed = FAILED * (2.0 - self.survived)
        return np.where(self.completed, np.sum(coefficients * self.terms, axis=-1), failed)


def evaluate(objective: Objective, vectors: np.ndarray, samples: Samples, precision: str = "float64") -> Evaluated:
    """Terms of every candidate (C, n) on every sample.

    In float32 a batch is twice as fast. Ranks of candidates that lie a factor of 1.35 apart in each gain are those of
    float64 (correlation 0.99 on ``sensed``); at a factor of 1.05 they are not (0.82 to 0.87).
    """
    found = Evaluated(*on_pairs(_TERMS, objective, vectors, samples, np.zeros(len(TERMS)), precision))
    check_finite(found.terms, found.completed)
    return found


def gradients(
    objective: Objective, vectors: np.ndarray, samples: Samples, coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Costs (C, N) and their gradients (C, N, n), by reverse mode.

    ``coefficients`` are (9,), or (C, 9) where every candidate has its own.

    Reverse mode costs 5 to 6 cost evaluations whatever n, forward mode about 1 + 2 n (measured): forward mode would pay
    for two numbers or one, too rarely for a program of its own.
    """
    costs, slopes = on_pairs(_GRADIENT, objective, vectors, samples, coefficients)
    return costs, slopes


def compile_costs(objective: Objective, samples: Samples, precision: str) -> None:
    """Compile what ``evaluate`` runs on samples of this structure."""
    compile_pairs(_TERMS, objective, samples, len(TERMS), precision)


def compile_gradients(objective: Objective, samples: Samples) -> None:
    """Compile what ``gradients`` runs on samples of this structure."""
    compile_pairs(_GRADIENT, objective, samples, len(TERMS), "float64")


def compile_pairs(kind: Kind, objective: Any, samples: Samples, coefficients: int, precision: str) -> None:
    """Compile what ``on_pairs`` runs on samples of this structure, with so many coefficients."""
    layout = kind.layout(samples)
    own, common = layout.split(samples.rows)
    sizes, dtype = (objective.space.size, own.shape[1], coefficients), np.dtype(precision)
    elements = tuple(jax.ShapeDtypeStruct((kind.size, size), dtype) for size in sizes)
    prepare(
        kind.program(objective, layout), slots(kind.size)[0], elements, (jax.ShapeDtypeStruct(common.shape, dtype),)
    )


def sensitivities(
    objective: Objective, vectors: np.ndarray, samples: Samples, coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Costs (C, N) and their gradients by the samples' own numbers (C, N, leaves), in the order of ``Samples.rows``."""
    costs, slopes = on_pairs(_SENSITIVITY, objective, vectors, samples, coefficients)
    return costs, slopes


def on_pairs(
    kind: Kind,
    objective: Any,
    vectors: np.ndarray,
    samples: Samples,
    coefficients: np.ndarray,
    precision: str = "float64",
) -> list[np.ndarray]:
    """Results of every candidate on every sample, each (C, N, ...), in double precision.

    Args:
        kind: function of a pair.
        objective: that it takes; static.
        vectors: candidates (C, n).
        samples: N of them.
        coefficients: that it takes: (k,), (C, k), or (C, N, k) where every pair has its own.
        precision: float64 or float32.
    """
    candidates, count = len(vectors), len(samples)
    layout = kind.layout(samples)
    if coefficients.ndim < 3:
        coefficients = np.broadcast_to(coefficients, (candidates, coefficients.shape[-1]))[:, None]
    coefficients = np.broadcast_to(coefficients, (candidates, count, coefficients.shape[-1]))
    numbers = (vectors, *layout.split(samples.rows), coefficients)
    vectors, own, common, coefficients = (x.astype(precision) for x in numbers)
    program = kind.program(objective, layout)

    def compute(device: Device, pairs: np.ndarray) -> Any:
        candidate, sample = np.divmod(pairs, count)
        with naming(f"candidates {candidate[0]} to {candidate[-1]} on samples {sample.min()} to {sample.max()}"):
            elements = (vectors[candidate], own[sample], coefficients[candidate, sample])
            return run(program, device, elements, (common,))

    arrays = in_batches(compute, candidates * count, kind.size)
    arrays = (array.astype(float) if array.dtype == np.float32 else array for array in arrays)
    return [array.reshape(candidates, count, *array.shape[1:]) for array in arrays]


def _terms(
    objective: Objective, layout: Layout, vector: jax.Array, own: jax.Array, _: jax.Array, common: jax.Array
) -> tuple:
    terms, completed, survived = objective.evaluate(vector, layout.parameters(own, common))
    return jnp.stack(terms), completed, survived


def _gradient(*arguments: Any) -> tuple:
    return jax.value_and_grad(_cost, 2)(*arguments)


def _sensitivity(*arguments: Any) -> tuple:
    return jax.value_and_grad(_cost, 3)(*arguments)


def _cost(
    objective: Objective, layout: Layout, vector: jax.Array, own: jax.Array, coefficients: jax.Array, common: jax.Array
) -> Scalar:
    return objective.cost(vector, layout.parameters(own, common), coefficients, True)


_TERMS, _GRADIENT, _SENSITIVITY = Kind(_terms), Kind(_gradient, FEW), Kind(_sensitivity, by_sample=True)
