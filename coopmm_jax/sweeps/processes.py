"""Share of this process in a sweep.

>>> list(Share(rank=1, size=3).batches(8))
[1, 4, 7]
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.errors import UserError
from coopmm_jax.sweeps.rendezvous import meet


class Share(NamedTuple):
    """This process among those that share a sweep: process ``rank`` of ``size``."""

    rank: int = 0
    size: int = 1

    def batches(self, count: int) -> range:
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
