"""Progress of a search on stderr: stages by name, a line for each iteration, time left."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, NamedTuple, TextIO

from tuning.search.stages import HALF, Generations, Scan

if TYPE_CHECKING:
    from coopmm_jax.scenario.sections.tuning import TuningSection
    from tuning.studies.result import Row

_GOALS = "the largest soft requirement, 1 at its limit and less inside, plus 100 for each scale that a hard one misses"
FINER = 2.0  # times as long as in float32 takes a step in float64


class Mark(NamedTuple):
    """One instant of a search."""

    time: float  # [s]
    steps: int  # simulated until then


class TimeLeft:
    """Time that a search has still to go: what is left of either half of its budget, at the pace of that half.

    The first half, up to the second scan, may be in float32; the pace of the second one is a guess until it begins.
    """

    def __init__(self, settings: TuningSection):
        self.budget, self.half = 1e6 * settings.budget, 1e6 * HALF * settings.budget
        by_values = settings.optimiser in ("auto", "cma")  # gradients are in float64
        self.finer = FINER if by_values and settings.coarse == "float32" else 1.0
        self.last: Mark | None = None
        self.since, self.searched, self.second = Mark(0.0, 0), False, False

    def after(self, row: Row, now: float) -> float | None:
        """Time left [s] after a row that came at ``now`` [s]; None where the pace is not known yet."""
        mark, before = Mark(now, row.steps), self.last
        self.last = mark
        if before is None or row.iteration == 0:
            self.since, self.searched, self.second = mark, False, row.steps > self.half
            return None
        if row.stage == Scan.name and self.searched and not self.second:
            self.since, self.second = before, True
        self.searched = self.searched or row.stage == Generations.name
        pace = (now - self.since.time) / (row.steps - self.since.steps)
        left = max(0.0, self.budget - row.steps)
        if self.second:
            return pace * left
        later = min(left, self.budget - self.half)
        return pace * (left - later + self.finer * later)


class Progress:
    """Writes what a search says; on a terminal each line takes the place of the one before, a stage's last one stays.

    Args:
        settings: [tuning] of the search.
        stream: stderr if left out.
    """

    def __init__(self, settings: TuningSection, stream: TextIO | None = None):
        self.left, self.stream = TimeLeft(settings), stream or sys.stderr
        self.minimised = settings.minimised
        self.told = settings.goals == "cost"  # whether what is minimised needs no further word
        self.live = self.stream.isatty()
        self.open = False  # whether the cursor stands behind a line that the next one replaces

    def stage(self, name: str) -> None:
        """Say what begins."""
        self._end()
        self.stream.write(f"{name}\n")
        self.stream.flush()

    def row(self, row: Row) -> None:
        """Say what an iteration found."""
        left = self.left.after(row, time.monotonic())
        if not self.told:
            self.told = True
            self.stream.write(f"{self.minimised}: {_GOALS}\n")
        text = (
            f"{row.stage} {row.iteration}: {self.minimised} {row.training:.4g}, best {row.best:.4g}, "
            f"{row.steps / 1e6:.3g} of {self.left.budget / 1e6:.3g} M steps"
            f"{'' if left is None else f', {left:.0f} s left'}"
        )
        if row.rejected:
            text += f"; {row.rejected} steps rejected, the next ones reach half as far"
        if self.live:
            self.stream.write(f"\r{text}\x1b[K")
        else:
            self.stream.write(f"{text}\n")
        self.open = self.live
        self.stream.flush()

    def _end(self) -> None:
        if self.open:
            self.stream.write("\n")
            self.open = False
