"""Progress of a search on stderr: stages by name, a line for each iteration, time left."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from tuning.studies.result import Row


class Progress:
    """Writes what a search says; on a terminal each line takes the place of the one before, a stage's last one stays.

    Args:
        budget: simulated steps of the search.
        stream: stderr if left out.
    """

    def __init__(self, budget: float, stream: TextIO | None = None):
        self.budget, self.stream = budget, stream or sys.stderr
        self.live = self.stream.isatty()
        self.open = False  # whether the cursor stands behind a line that the next one replaces
        self.first: tuple[float, int] | None = None  # time [s] and steps at the first row

    def stage(self, name: str) -> None:
        """Say what begins."""
        self._end()
        self.stream.write(f"{name}\n")
        self.stream.flush()

    def row(self, row: Row) -> None:
        """Say what an iteration found."""
        text = (
            f"{row.stage} {row.iteration}: cost {row.training:.4g}, best {row.best:.4g}, "
            f"{row.steps / 1e6:.3g} of {self.budget / 1e6:.3g} M steps{self._left(row)}"
        )
        if row.rejected:
            text += f"; {row.rejected} steps rejected, the next ones reach half as far"
        if self.live:
            self.stream.write(f"\r{text}\x1b[K")
        else:
            self.stream.write(f"{text}\n")
        self.open = self.live
        self.stream.flush()

    def _left(self, row: Row) -> str:
        now = time.monotonic()
        if self.first is None or row.iteration == 0:
            self.first = (now, row.steps)
            return ""
        pace = (now - self.first[0]) / (row.steps - self.first[1])
        return f", {max(0.0, self.budget - row.steps) * pace:.0f} s left"

    def _end(self) -> None:
        if self.open:
            self.stream.write("\n")
            self.open = False
