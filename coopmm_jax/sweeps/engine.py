"""Batches on other processes: any ``concurrent.futures.Executor`` carries them in the place of this process's threads.

    with Client("tcp://head:8786") as client:  # Dask; a ProcessPoolExecutor that spawns, or MPI's pool, will do as well
        sweep("sensed", samples=100_000, out="sensed.zarr", executor=client.get_executor())

What goes to a worker is a batch: the program's name and choices, and its elements' numbers, 0.1 MB; what comes back are
the results, some kB. A worker compiles a program when it first meets it, keeps it, and computes a batch with the same
executable and as many neighbours as this process would: the bits are the same. Scenario, samples and results stay here,
so that nothing has to be shared but this package, at one version.

>>> from concurrent.futures import ThreadPoolExecutor
>>> width(ThreadPoolExecutor(3))
3
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from typing import Any, NamedTuple

import jax

from coopmm_jax import runtime
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import plugins, software
from coopmm_jax.kinds.registry import find, kind_of
from coopmm_jax.sweeps.batch import Elsewhere, Program, elsewhere, run, size_of
from coopmm_jax.sweeps.devices import suited

FIELD = "executor"
_AHEAD = 2  # batches for each worker: one that it computes, one that waits for it
_UNKNOWN = 16  # workers of an executor that does not say how many it has


class Order(NamedTuple):
    """A batch on its way to a worker."""

    plugins: tuple[plugins.Source, ...]  # files, whose kinds the content may name
    versions: Mapping[str, str]  # of the software here
    options: str  # of XLA here
    content: bytes  # program, elements and shared arguments, pickled


@contextlib.contextmanager
def carried_by(executor: Executor | None) -> Iterator[None]:
    """Have an executor's workers run every batch of this thread's calls; None: whatever did so far goes on.

    Raises:
        UserError: a pool of processes that are forked.
    """
    if executor is None:
        yield
        return
    context = getattr(executor, "_mp_context", None)
    if isinstance(executor, ProcessPoolExecutor) and context is not None and context.get_start_method() == "fork":
        must = 'made as ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn"))'
        raise UserError(FIELD, must, "a pool that forks, which JAX does not survive")
    token = elsewhere.set((_Remote(executor),) * (_AHEAD * width(executor)))
    try:
        yield
    finally:
        elsewhere.reset(token)


@contextlib.contextmanager
def naming(what: str) -> Iterator[None]:
    """Say in an executor's failure what it was computing.

    Raises:
        UserError: the block raises that failure.
    """
    try:
        yield
    except UserError as error:
        if error.field != FIELD:
            raise
        raise UserError(FIELD, error.must, f"{error.was}, for {what}") from None


def width(executor: Any) -> int:
    """Number of batches that an executor runs at a time; an estimate where it does not say."""
    if hasattr(executor, "_client"):  # Dask's
        return max(1, sum(executor._client.nthreads().values()))
    return getattr(executor, "num_workers", None) or getattr(executor, "_max_workers", None) or _UNKNOWN


class _Remote(Elsewhere):
    """A slot among an executor's workers."""

    def __init__(self, executor: Executor):
        self.executor = executor

    def run(self, program: Program, elements: tuple[Any, ...], shared: tuple[Any, ...]) -> Any:
        content = _pickled((program, elements, shared))
        order = Order(plugins.sources(), software.versions(), runtime.xla_options(), content)
        try:
            found = self.executor.submit(work, order).result()
        except UserError:
            raise
        except ImportError as error:
            raise UserError(FIELD, "one whose workers have coopmm_jax", f"{type(error).__name__}: {error}") from None
        except Exception as error:  # of the worker's, or of the engine that has lost it
            raise UserError(FIELD, "one whose workers can run a batch", f"{type(error).__name__}: {error}") from None
        if isinstance(found, _Refusal):
            raise UserError(FIELD, found.must, found.was)
        return found


class _Refusal(NamedTuple):
    """Answer of a worker that would compute other bits."""

    must: str
    was: str


def work(order: Order) -> Any:
    """Results of a batch, in a worker.

    Args:
        order: of the batch.
    """
    try:
        plugins.load_sources(order.plugins)
    except UserError as error:
        return _Refusal(f"one whose workers can load its plugins ({error.field}: must be {error.must})", str(error.was))
    refusal = _refusal(order)
    if refusal is not None:
        return refusal
    if jax.config.values["jax_compilation_cache_dir"] is None:
        runtime.use_compilation_cache()
    program, elements, shared = pickle.loads(order.content)
    return run(program, suited(size_of(elements))[0], elements, shared)


def _refusal(order: Order) -> _Refusal | None:
    """Reason why this process would not compute the same bits as the one that has sent the order."""
    here = software.versions()
    for name, version in order.versions.items():
        if here.get(name) != version:
            return _Refusal(
                f"one whose workers have {name} {version}, as this process has", f"{here.get(name, 'none')}"
            )
    if not runtime.backend_is_up():
        counts = [flag for flag in os.environ.get("XLA_FLAGS", "").split() if "device_count" in flag]
        os.environ["XLA_FLAGS"] = " ".join([order.options, *counts]).strip()
    if runtime.xla_options() != order.options:
        return _Refusal(f"one whose workers have XLA_FLAGS={order.options}", runtime.xla_options() or "empty")
    return None


class _Pickler(pickle.Pickler):
    """Names kinds by their group and name: those with nothing but constants are classes that no module has."""

    def reducer_override(self, obj: Any) -> Any:
        kind = kind_of(obj) if isinstance(obj, type) else None
        return NotImplemented if kind is None else (_class_of, (kind.group, kind.name))


def _class_of(group: str, name: str) -> type:
    return find(group, name).made


def _pickled(content: Any) -> bytes:
    stream = io.BytesIO()
    _Pickler(stream, protocol=pickle.HIGHEST_PROTOCOL).dump(content)
    return stream.getvalue()
