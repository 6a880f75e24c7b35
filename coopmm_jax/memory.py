"""Memory that a computation is going to take, so that too much is refused before it begins.

>>> check_memory(1e3, "simulation.duration", "shorter", 20.0)
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

from coopmm_jax.errors import UserError

GIGABYTE = 1e9
_LIMITS = (  # of a container: what it may use, what it uses
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


def check_memory(
    needed: float, field: str, must: str, was: Any, free: float | None = None, whose: str = "memory"
) -> None:
    """Refuse what does not fit into the free memory.

    Args:
        needed: estimate of the memory [byte].
        field: setting to change.
        must: what it must be for less memory.
        was: its value.
        free: memory that there is [byte]; left out, this process's.
        whose: memory it is, in words.

    Raises:
        UserError: it takes more than there is.
    """
    free = free_memory() if free is None else free
    if needed > free:
        takes = f"it takes {needed / GIGABYTE:.3g} GB of {whose}, {free / GIGABYTE:.3g} GB are free"
        raise UserError(field, f"{must} ({takes})", was)


def free_memory() -> float:
    """Memory that this process can still get [byte]."""
    found = [float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")]
    with contextlib.suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        found.append(1024.0 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1]))
    for limit, used in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # the limit may be the word "max"
            found.append(float(Path(limit).read_text("ascii")) - float(Path(used).read_text("ascii")))
    return max(0.0, min(found))
