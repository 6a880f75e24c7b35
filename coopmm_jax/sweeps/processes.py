"""Share of this process in a sweep, and the spread of its batches over its devices.

>>> list(Share(rank=1, size=3).tiles(8))
[1, 4, 7]
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, as_completed, wait
from queue import SimpleQueue
from typing import Any, NamedTuple, TypeAlias

from coopmm_jax.errors import UserError
from coopmm_jax.sweeps.rendezvous import meet

Device: TypeAlias = Any  # a jax.Device, for which JAX has no class that type checkers know


class Share(NamedTuple):
    """This process among those that share a sweep: process ``rank`` of ``size``."""

    rank: int = 0
    size: int = 1

    def tiles(self, count: int) -> range:
        """Batches of this process, of ``count`` in all."""
        return range(self.rank, count, self.size)


def share(
    rank: int | None = None, size: int | None = None, coordinator: str | None = None, distributed: bool = False
) -> Share:
    """Share of this process, from numbers given by hand or from ``jax.distributed``.

    The processes meet in the store alone, so rank and size are enough.

    Args:
        rank: number of this process, from 0.
        size: number of processes.
        coordinator: "host:port" where the processes find each other through ``jax.distributed``.
        distributed: let ``jax.distributed`` find all that by itself, as it does under Slurm, Open MPI, on Cloud TPUs.

    Raises:
        UserError: numbers that do not fit together, or no cluster found.
    """
    mine = _by_hand(rank, size)
    if distributed and mine is not None:
        raise UserError("--distributed", "left out where --rank and --size are given", "given")
    if coordinator is not None and mine is None:
        raise UserError("--coordinator", "given together with --rank and --size", "given alone")
    if not distributed and coordinator is None:
        return mine or Share()
    import jax

    if coordinator is not None and mine is not None:
        meet(coordinator, mine.size, mine.rank)
    jax.config.update("jax_enable_preemption_service", False)  # it would take SIGTERM for itself
    try:
        jax.distributed.initialize(coordinator, size, rank)
    except (ValueError, RuntimeError) as error:
        raise UserError("--distributed", "used where jax.distributed finds its cluster", str(error)) from None
    return Share(jax.process_index(), jax.process_count())


def _by_hand(rank: int | None, size: int | None) -> Share | None:
    if rank is None or size is None:
        if rank is not size:
            raise UserError("--rank", "given together with --size", "given alone" if size is None else "missing")
        return None
    if not 0 <= rank < size:
        raise UserError("--rank", f"from 0 to --size - 1 ({size - 1})", rank)
    return Share(rank, size)


def slots() -> list[Device]:
    """Local devices, each as often as it should have batches in flight.

    A batch keeps one CPU core busy, so the CPU's devices get one thread for each core; another device gets two, so that
    it computes while the host writes.
    """
    import jax

    devices = jax.local_devices()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    each = max(1, cores // len(devices)) if devices[0].platform == "cpu" else 2
    return devices * each


def concurrently(function: Callable[[Any, Any], Any], items: Iterable[Any], slots: list[Any]) -> Iterator[Any]:
    """Results of ``function(slot, item)`` for every item, one at a time in each slot, in the order in which they end.

    Items are taken only when a slot is free, so however many there are, few exist at a time. After an exception no
    further item is taken, and it is raised when those under way have ended.
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
        pending: set = set()
        for item in items:
            if len(pending) == len(slots):
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
            pending.add(pool.submit(run, item))
        yield from (future.result() for future in as_completed(pending))
