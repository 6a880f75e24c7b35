"""Batches: a fixed number of elements through a program that is compiled once, as many at a time as devices can take.

Every element goes through the same executable with the same number of neighbours, so its bits depend neither on how
many elements there are, nor on where a sweep was interrupted, nor on how many processes share it.

>>> in_batches(lambda device, rows: rows**2, count=5, size=2)
array([ 0,  1,  4,  9, 16])
"""

from __future__ import annotations

import contextlib
import functools
import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import ContextVar
from queue import SimpleQueue
from typing import Any, NamedTuple, TypeAlias

import jax
import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.sweeps.devices import AT_ONCE, on_its_own, suited

Device: TypeAlias = Any  # a jax.Device, for which JAX has no class that type checkers know, or ``Elsewhere``
_KEPT = 24  # executables


class Program(NamedTuple):
    """Function of one batch element, and what is fixed when it is compiled."""

    function: Callable[..., Any]  # (*fixed, *elements, *shared), at the top of a module
    fixed: tuple[Hashable, ...]
    options: tuple[tuple[str, Any], ...] = ()  # of XLA, by name


class Elsewhere(ABC):
    """A slot that is no device of this process; what runs there is compiled there."""

    @abstractmethod
    def run(self, program: Program, elements: tuple[Any, ...], shared: tuple[Any, ...]) -> Any:
        """Results of a batch, as the function ``run`` has them."""


# Slots in the place of the local devices, for calls from within ``engine.carried_by``.
elsewhere: ContextVar[tuple[Elsewhere, ...]] = ContextVar("elsewhere", default=())


def run(program: Program, device: Device, elements: tuple[Any, ...], shared: tuple[Any, ...] = ()) -> Any:
    """Results of a batch, NumPy arrays (B, ...), in double precision if any argument is.

    Args:
        program: compiled if it has not been yet for this device and arguments of these shapes.
        device: to run on, or a slot elsewhere.
        elements: arguments that each batch element has its own of: pytrees of NumPy arrays (B, ...), () for all alike.
        shared: arguments that all have in common: pytrees of NumPy arrays.

    Raises:
        UserError: it does not fit into the device's memory.
    """
    if isinstance(device, Elsewhere):
        return device.run(program, elements, shared)
    with jax.enable_x64(_double((elements, shared))), _fitting(device, elements):  # of this thread only
        executable = _executable(program, device, elements, shared)
        return jax.device_get(executable(*jax.device_put((*elements, *shared), device)))


def prepare(program: Program, device: Device, elements: tuple[Any, ...], shared: tuple[Any, ...] = ()) -> None:
    """Compile what ``run`` needs for arguments of these shapes; ``jax.ShapeDtypeStruct`` will do for an array.

    Raises:
        UserError: it does not fit into the device's memory.
    """
    if isinstance(device, Elsewhere):
        return
    with jax.enable_x64(_double((elements, shared))), _fitting(device, elements):
        _executable(program, device, elements, shared)


def in_batches(compute: Callable[[Device, np.ndarray], Any], count: int, size: int) -> Any:
    """Results of N elements, computed batch by batch on all devices: a pytree of arrays (N, ...).

    Args:
        compute: results (B, ...) of the elements at some positions (B,), on a device.
        count: number of elements N, at least one.
        size: of a batch B. The last one is filled up with the last element.
    """
    starts = range(0, count, size)
    found: dict[int, Any] = {}

    def one(device: Device, start: int) -> None:
        found[start] = compute(device, np.minimum(np.arange(start, start + size), count - 1))

    for _ in concurrently(one, starts, slots(size)):
        pass
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *(found[start] for start in starts))


def slots(size: int = 1) -> list[Device]:
    """Slots of ``engine.carried_by``, or else local devices, each as often as it should have batches in flight.

    A batch keeps one CPU core busy, so the CPU's devices get one thread for each core; another device gets two, so that
    it computes while the host writes.

    Args:
        size: of the batches, which says whether a GPU suits them.
    """
    if elsewhere.get():
        return list(elsewhere.get())
    devices = suited(size)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return devices * (AT_ONCE if on_its_own(devices[0]) else max(1, cores // len(devices)))


def place(device: Device, size: int) -> Device:
    """Device for a batch of another size than the one that is on its way to ``device``."""
    devices = suited(size)
    return device if isinstance(device, Elsewhere) or device in devices else devices[0]


def size_of(elements: tuple[Any, ...]) -> int:
    """Number of a batch's elements."""
    return max((leaf.shape[0] for leaf in jax.tree.leaves(elements) if leaf.shape), default=1)


def concurrently(function: Callable[[Any, Any], Any], items: Iterable[Any], slots: list[Any]) -> Iterator[Any]:
    """Results of ``function(slot, item)`` for every item, one at a time in each slot, in the order in which they end.

    Items are taken only when a slot is free, so however many there are, few exist at a time. After an exception no
    further item is taken, and it is raised when those under way have ended: the first item's, if several fail.
    """
    free: SimpleQueue = SimpleQueue()
    for slot in slots:
        free.put(slot)

    def run(item: Any) -> Any:
        slot = free.get()
        try:
            return function(slot, item)
        finally:
            free.put(slot)

    with ThreadPoolExecutor(len(slots)) as pool:
        pending: list[Future] = []
        for item in items:
            if len(pending) == len(slots):
                yield from _ended(pending)
            pending.append(pool.submit(run, item))
        while pending:
            yield from _ended(pending)


def _ended(pending: list[Future]) -> list[Any]:
    """Results of what has ended, which is taken off the list; of several exceptions the first item's is raised."""
    done, _ = wait(pending, return_when=FIRST_COMPLETED)
    if any(future.exception() for future in done):
        done, _ = wait(pending)
    ended = [future for future in pending if future in done]
    pending[:] = [future for future in pending if future not in done]
    return [future.result() for future in ended]


@contextlib.contextmanager
def _fitting(device: Device, elements: tuple[Any, ...]) -> Iterator[None]:
    """Say in one line that a batch does not fit into a device's memory."""
    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if "RESOURCE_EXHAUSTED" not in str(error):
            raise
        must = f"small enough for the free memory of {device.device_kind}"
        reason = str(error).partition("RESOURCE_EXHAUSTED")[2].lstrip(": ").partition("\n")[0].partition(" [")[0]
        raise UserError("batch", must, f"{size_of(elements)} ({reason})") from None


class _Compilation:
    """Executable that the first thread to need it compiles, while others that need it wait and other programs go on."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.executable: Any = None


_looking_up = threading.Lock()  # two threads that miss at the same time would get two compilations


@functools.lru_cache(maxsize=_KEPT)
def _compilation(*key: Hashable) -> _Compilation:
    return _Compilation()


def _executable(program: Program, device: Device, elements: tuple[Any, ...], shared: tuple[Any, ...]) -> Any:
    leaves, structure = jax.tree.flatten((elements, shared))
    with _looking_up:
        entry = _compilation(program, device, structure, tuple((leaf.shape, leaf.dtype) for leaf in leaves))
    with entry.lock:
        if entry.executable is None:
            entry.executable = _compiled(program, device, elements, shared)
    return entry.executable


def _compiled(program: Program, device: Device, elements: tuple[Any, ...], shared: tuple[Any, ...]) -> Any:
    place = jax.sharding.SingleDeviceSharding(device)
    described = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=place), (*elements, *shared))
    own = jax.tree.map(lambda x: 0 if x.shape else None, elements)
    axes = (*own, *(None,) * len(shared))
    function = jax.vmap(functools.partial(program.function, *program.fixed), in_axes=axes)
    return jax.jit(function).lower(*described).compile(compiler_options=dict(program.options) or None)


def _double(arguments: Any) -> bool:
    return any(leaf.dtype == np.float64 for leaf in jax.tree.leaves(arguments))
