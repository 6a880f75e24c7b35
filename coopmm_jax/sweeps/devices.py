"""Devices that suit batches of a size, and the size of batches that suits a device.

A core of a processor is fastest with 64 rollouts at a time, which stay in its first-level cache. On a GPU a step takes
as long for one rollout as for thousands: 0.22 ms for 1,024 on one H100, 0.24 for 4,096, 0.28 for 16,384, 0.60 for
65,536 and 1.17 for 131,072 (``sensed``, float64, all metrics; 1.6 to 2.5 times that for the continuous loop of
``paper_full``; ``python -m experiments.benchmarks.accelerator --metrics``). So it gets batches of tens of thousands,
and what comes in small ones is left to the processor beside it.

>>> suited(1)[0].platform
'cpu'
"""

from __future__ import annotations

import contextlib
import math
from typing import Any

import jax

OF_A_CORE = 64
LARGEST = 65536  # twice as large a batch does 2 % more per second (``sensed``) and takes twice the memory
GRAIN = 16384  # a smaller batch ends at most a quarter sooner, and each other size is compiled anew
LEAST = 4096  # of fewer rollouts a processor of a few cores does more per second
AT_ONCE = 2  # batches on a device other than a processor: it computes one while the host writes the other


def suited(size: int) -> list[Any]:
    """Local devices that batches of a size should run on: the processor's, if there is a GPU and they are too small.

    Args:
        size: rollouts of a batch.
    """
    devices = jax.local_devices()
    if size < LEAST and on_its_own(devices[0]):
        with contextlib.suppress(RuntimeError):  # JAX_PLATFORMS leaves the processor out
            return jax.local_devices(backend="cpu")
    return devices


def on_its_own(device: Any) -> bool:
    """True for a device that is no processor of the host's."""
    return getattr(device, "platform", "cpu") != "cpu"


def free_memory_of(device: Any) -> float:
    """Memory that batches can get on a device that is no processor [byte]; infinite where it does not say."""
    stats = device.memory_stats() or {}
    return float(stats.get("bytes_limit", math.inf)) - float(stats.get("bytes_in_use", 0.0))


def suitable_batch(samples: int, per_rollout: float, processes: int = 1) -> int:
    """Size of the batches in which the local devices compute a sweep soonest.

    From 4,096 samples on a GPU takes them, in few batches of many rollouts, as its memory allows.

    Args:
        samples: of the sweep.
        per_rollout: memory of one [byte].
        processes: that share the sweep.

    >>> suitable_batch(1000, per_rollout=6000.0)
    64
    """
    devices = jax.local_devices()
    if samples < LEAST or not on_its_own(devices[0]):
        return OF_A_CORE
    room = min(map(free_memory_of, devices)) / (AT_ONCE * per_rollout)
    largest = max(LEAST, int(min(LARGEST, room)) // LEAST * LEAST)
    each = -(-samples // (processes * len(devices)))
    batch = -(-each // -(-each // largest))
    return min(largest, -(-batch // GRAIN) * GRAIN)
