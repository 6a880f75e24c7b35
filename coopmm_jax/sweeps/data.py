"""Data set of a sweep, with a line on how its samples ended."""

from __future__ import annotations

import numpy as np

from coopmm_jax.runs.dataset import Labelled
from coopmm_jax.status import Status


class SweepData(Labelled):
    """Parameters, metrics, status and kept series by sample."""

    __slots__ = ()

    def about(self) -> list[str]:
        """Number of samples, of those computed, and of each way in which they ended."""
        if "status" not in self or self.status.ndim != 1:
            return []
        codes, counts = np.unique(self.status.values, return_counts=True)
        ended = {code: count for code, count in zip(codes.tolist(), counts.tolist(), strict=True) if code >= 0}
        line = f"Sweep: {sum(ended.values())} of {len(self.status)} samples computed"
        return [", ".join([line, *(f"{count} {Status(code).name}" for code, count in ended.items())])]
