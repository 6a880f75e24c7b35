"""Climbing a cost over a box from many starts, within a budget of evaluations: the search under ``falsify``.

Worst cases of a robust design tend to lie where several numbers are at their ends at once, which random points of a
box with many sides never come near. So every climb tries steps along its gradient from short to endless, all cut off
at the box: the endless one puts every number at the end its slope points to, the long ones only those that matter.

>>> class Plane:
...     low, high, slope_price = np.zeros(2), np.ones(2), 1
...     def values(self, points):
...         return points[:, 0] - points[:, 1]
...     def slopes(self, points, values):
...         return np.tile([1.0, -1.0], (len(points), 1))
>>> ascend(Plane(), np.full((1, 2), 0.5), budget=20).peaks[0].point
array([1., 0.])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

# How far the coordinate of the steepest slope would move, in widths of the box, were there no box.
LADDER = (1e6, 8.0, 2.0, 0.5, 0.13, 0.03, 0.008)
_WORTH = 1e-6  # relative gain below which a climb is at its top


class Landscape(Protocol):
    """Function that is climbed."""

    low: np.ndarray  # (D,) of the box
    high: np.ndarray
    slope_price: int  # evaluations that one gradient costs

    def values(self, points: np.ndarray) -> np.ndarray:
        """Cost at points (N, D) -> (N,); finite."""
        ...

    def slopes(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Gradient (N, D) at points (N, D), whose values (N,) are known."""
        ...


class Peak(NamedTuple):
    """A point and its cost."""

    point: np.ndarray  # (D,)
    value: float


class Mark(NamedTuple):
    """Progress of a search."""

    spent: int  # evaluations
    value: float  # the highest so far


@dataclass(frozen=True)
class Ascent:
    """Findings of a search."""

    peaks: list[Peak]  # where climbs ended, different ones, the highest first
    trail: list[Mark]  # after the starts, and after every round
    spent: int  # evaluations


def ascend(landscape: Landscape, starts: np.ndarray, budget: int, climbers: int = 4, enough: float = np.inf) -> Ascent:
    """Climb from the highest of the starts; a climb at its top makes room for the next start.

    Args:
        landscape: the function and its box.
        starts: (S, D) in the box, as many of them as the budget has room for.
        budget: evaluations, never exceeded.
        climbers: climbs at a time.
        enough: a value at which the search ends at once.
    """
    points = starts[:budget]
    values = landscape.values(points)
    waiting = [Peak(points[i], float(values[i])) for i in np.argsort(-values, kind="stable")]
    climbs, tops, spent = [], [], len(points)
    trail = [Mark(spent, waiting[0].value)]
    while trail[-1].value < enough:
        room = min(climbers, (budget - spent) // (landscape.slope_price + len(LADDER)))
        while waiting and len(climbs) < room:
            climbs.append(waiting.pop(0))
        active, resting = climbs[:room], climbs[room:]
        if not active:
            break
        moved, price = _climb(landscape, active)
        spent += price
        tops += [new for old, new in zip(active, moved, strict=True) if not _rises(old, new)]
        rising = [new for old, new in zip(active, moved, strict=True) if _rises(old, new)]
        ended = {_key(top) for top in tops}
        climbs = [climb for climb in _different(rising + resting) if _key(climb) not in ended]
        trail.append(Mark(spent, max(peak.value for peak in (*moved, *tops))))
    return Ascent(_different(tops + climbs + waiting), trail, spent)


def _climb(landscape: Landscape, climbs: list[Peak]) -> tuple[list[Peak], int]:
    """Every climb at the best of its trial points, or where it was; and how many evaluations that took."""
    points, values = np.stack([c.point for c in climbs]), np.array([c.value for c in climbs])
    directions = _uphill(landscape, points, landscape.slopes(points, values))
    trials = points[:, None] + np.array(LADDER)[:, None] * directions[:, None]
    trials = np.clip(trials, landscape.low, landscape.high)
    free = np.flatnonzero(directions.any(axis=1))
    moved = list(climbs)
    if len(free):
        tried = landscape.values(trials[free].reshape(-1, points.shape[1])).reshape(len(free), -1)
        for i, outcome in zip(free, tried, strict=True):
            best = int(np.argmax(outcome))
            if outcome[best] > climbs[i].value:
                moved[i] = Peak(trials[i, best], float(outcome[best]))
    return moved, len(climbs) * landscape.slope_price + len(free) * len(LADDER)


def _uphill(landscape: Landscape, points: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Along the gradients without what would leave the box, the longest entry a width of it; zeros at a top."""
    width = landscape.high - landscape.low
    slopes = np.where(np.isfinite(slopes), slopes, 0.0) * width
    blocked = ((points >= landscape.high) & (slopes > 0.0)) | ((points <= landscape.low) & (slopes < 0.0))
    slopes = np.where(blocked, 0.0, slopes)
    steepest = np.max(np.abs(slopes), axis=1, keepdims=True)
    return slopes / np.where(steepest > 0.0, steepest, 1.0) * width


def _rises(old: Peak, new: Peak) -> bool:
    return new.value > old.value + _WORTH * abs(old.value)


def _different(peaks: list[Peak]) -> list[Peak]:
    """The highest first, without those at a point that another holds."""
    kept: dict[bytes, Peak] = {}
    for peak in sorted(peaks, key=_height):
        kept.setdefault(_key(peak), peak)
    return list(kept.values())


def _height(peak: Peak) -> float:
    return -peak.value


def _key(peak: Peak) -> bytes:
    return peak.point.tobytes()
