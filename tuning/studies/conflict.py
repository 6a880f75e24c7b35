"""Hard requirements that no gains keep together, as far as a search has seen.

>>> conflicting(2, {(True, False), (False, True)})
(0, 1)
>>> conflicting(2, {(True, True)}) is None
True
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from tuning.cost.problem import Problem
    from tuning.cost.trials import Kept

_MOST = 4  # requirements of a conflict; larger sets tell a reader little


class Conflict(NamedTuple):
    """Hard requirements that the chosen gains do not keep on the fixed samples, and why."""

    missed: tuple[str, ...]  # not kept by the chosen gains
    between: tuple[str, ...]  # kept together by no candidate, though each smaller part of them was; () if unknown
    fixed: bool  # whether that was seen on the fixed samples alone, by few candidates

    def __str__(self) -> str:
        if not self.between:
            return (
                f"hard requirements not kept: {'; '.join(self.missed)}. The search saw no conflict: try a larger budget"
            )
        where = "checked on the fixed robots " if self.fixed else ""
        if len(self.between) == 1:
            return f"no candidate {where}kept {self.between[0]}"
        alone = "each alone was" if len(self.between) == 2 else "all but one of them were"
        return f"conflict: no candidate {where}kept {' and '.join(self.between)} together, though {alone}"


def conflict_of(problem: Problem, vector: np.ndarray, kept: Kept) -> Conflict | None:
    """Conflict that the search of a vector (n,) has met; None if it keeps all hard requirements on the fixed samples.

    Args:
        problem: that was searched.
        vector: the gains that were chosen.
        kept: hard requirements that candidates have kept together.
    """
    goals = problem.goals
    if goals is None or not goals.hard:
        return None
    met = goals.assess(problem.space.inside(vector[None]), problem.fixed).kept[0]
    if met.all():
        return None
    names = [str(goals.requirements[i]) for i in goals.hard]
    missed = tuple(name for name, ok in zip(names, met, strict=True) if not ok)
    for fixed, sets in ((False, kept.drawn), (True, kept.fixed)):
        found = conflicting(len(names), sets)
        if found is not None:
            return Conflict(missed, tuple(names[i] for i in found), fixed)
    return Conflict(missed, (), fixed=True)


def conflicting(count: int, kept: Collection[tuple[bool, ...]]) -> tuple[int, ...] | None:
    """Smallest set of requirements, by position, that nobody has kept together; None if there is none of up to four.

    Args:
        count: of the requirements H.
        kept: what candidates have kept, tuples (H,) of booleans.
    """
    for size in range(1, min(count, _MOST) + 1):
        for chosen in combinations(range(count), size):
            if not any(all(each[i] for i in chosen) for each in kept):
                return chosen
    return None
