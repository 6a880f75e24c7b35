"""Figure of an animation: the places of each run's views, and the words above them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.animation.scene import PRESSES, PULLS, Cast
from coopmm_jax.animation.skeleton import Skeleton, skeleton
from coopmm_jax.animation.views import GROUND, ForceStrip, SideView, TopView, extent
from coopmm_jax.plotting import style
from coopmm_jax.plotting.lines import Run

DPI = 100
# [pixel]: around the figure, for the labels left of and below a view, and the words above one.
EDGE, LEFT, BELOW, ABOVE = 12, 46, 40, 24
LINE = 14  # height of a run's name above the rest [pixel]
LETTER = 7  # width of one in it, estimated [pixel]
STRIP = 90  # height of a force strip under the other views [pixel]
WORLD_SHARE = 0.54  # of the width of a single run's views


class View(Protocol):
    """A part of the figure that moves from frame to frame."""

    cast: Cast

    def show(self, k: int) -> None:
        """Move everything to frame k."""


class Readout:
    """Words above a view that change from frame to frame."""

    def __init__(self, axes: Axes, words: Sequence[str], colours: Sequence[str]):
        """
        Args:
            axes: of the view.
            words: one text for each frame.
            colours: of the text, one for each frame.
        """
        self._words, self._colours = words, colours
        self.cast = Cast(axes)
        look = {"clip_on": False, "ha": "left", "va": "bottom", "fontsize": 8, "fontweight": "normal"}
        self._text = self.cast.text("", transform=axes.transAxes, **look)
        self._text.set_position((0.0, 1.02))

    def show(self, k: int) -> None:
        """Show the words of frame k."""
        self._text.set(text=self._words[k], color=self._colours[k])


class Box(NamedTuple):
    """A view's place in the figure [pixel], from the lower left corner."""

    x: int
    y: int
    width: int
    height: int


class Layout(NamedTuple):
    """Places of the views from above, from the side and of the force, for each run, and the figure's size [pixel]."""

    boxes: list[tuple[Box, Box, Box]]
    width: int
    height: int


def row_layout(width: int, above: int, side_ratio: float) -> Layout:
    """One run: the view from above on the left; on the right the one from the side above the force.

    Args:
        width: of the figure [pixel].
        above: room for the words over the views [pixel].
        side_ratio: height over width of the view from the side.
    """
    room = width - 2 * (LEFT + EDGE)
    world = round(WORLD_SHARE * room)
    right = room - world
    side = min(round(right * side_ratio), world - BELOW - ABOVE - STRIP // 2)
    x = LEFT + world + EDGE + LEFT
    boxes = (
        Box(LEFT, BELOW, world, world),
        Box(x, BELOW + world - side, right, side),
        Box(x, BELOW, right, world - side - BELOW - EDGE),
    )
    return Layout([boxes], width, _even(BELOW + world + above))


def cuts(runs: int, width: int) -> list[int]:
    """Places [pixel] from the left at which the figure can be cut into parts that a narrow screen shows one by one.

    >>> cuts(2, 800), cuts(1, 800)
    ([400], [421])
    """
    if runs > 1:
        return [i * (width // runs) for i in range(1, runs)]
    return [LEFT + round(WORLD_SHARE * (width - 2 * (LEFT + EDGE))) + EDGE // 2]


def column_layout(runs: int, width: int, above: int, side_ratio: float) -> Layout:
    """Several runs side by side, the views of each below one another.

    Args:
        runs: number of runs.
        width: of the figure [pixel].
        above: room for the words over the views [pixel].
        side_ratio: height over width of the view from the side.
    """
    column = width // runs
    view = column - LEFT - EDGE
    side = round(view * side_ratio)
    at_side = BELOW + STRIP + EDGE + BELOW
    at_world = at_side + side + ABOVE + BELOW
    boxes = [
        (Box(x, at_world, view, view), Box(x, at_side, view, side), Box(x, BELOW, view, STRIP))
        for x in range(LEFT, runs * column, column)
    ]
    return Layout(boxes, width, _even(at_world + view + above))


@style.styled
def stage(group: Sequence[Run], times: np.ndarray, width: int) -> tuple[Figure, list[View]]:
    """Figure and its views, each with ``show(k)`` and the ``cast`` that it moves.

    Args:
        group: runs with their labels.
        times: of the frames (F,) [s].
        width: of the figure [pixel].
    """
    skeletons = [skeleton(run.trajectory, instants(run.trajectory.t, times)) for run in group]
    extents = [extent(run.trajectory, s) for run, s in zip(group, skeletons, strict=True)]
    reach, half_width, top = np.max(extents, axis=0)
    ratio = (top + GROUND) / (2.0 * half_width)
    above = ABOVE + (LINE if any(run.label for run in group) else 0)
    layout = row_layout(width, above, ratio) if len(group) == 1 else column_layout(len(group), width, above, ratio)
    figure = Figure(figsize=(layout.width / DPI, layout.height / DPI), dpi=DPI)
    figure.set_layout_engine("none")  # every view has its place
    limits = _force_limits(group)
    views: list[View] = []
    for run, s, boxes in zip(group, skeletons, layout.boxes, strict=True):
        top_axes, side_axes, strip_axes = (_axes(figure, layout, box) for box in boxes)
        strip_axes.set_xlim(0.0, times[-1] or 1.0)
        name = shortened(run.label, boxes[0].width // LETTER)
        top_axes.set_title(name, loc="left", fontsize=8, fontweight="bold", pad=72.0 * ABOVE / DPI)
        views += [
            TopView(top_axes, run.trajectory, s, reach),
            SideView(side_axes, run.trajectory, s, half_width, top),
            ForceStrip(strip_axes, run.trajectory, s, limits),
            _clock(top_axes, run, times),
            _force_readout(side_axes, s),
        ]
    return figure, views


def instants(t: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Indices (F,) of the last samples at t (T,) that are not after the times of the frames (F,).

    >>> instants(np.array([0.0, 0.1, 0.2]), np.array([0.0, 0.15, 0.2, 7.0])).tolist()
    [0, 1, 2, 2]
    """
    slack = 1e-6 * (1.0 + times)  # times are multiples in another rounding, and may be in float32
    return np.maximum(np.searchsorted(t, times + slack, side="right") - 1, 0)


def shortened(name: str, letters: int) -> str:
    """Name cut to a number of letters.

    >>> shortened("gains.K_lambda 0.3", 12)
    'gains.K_lam…'
    """
    return name if len(name) <= letters else f"{name[: letters - 1]}…"


def _axes(figure: Figure, layout: Layout, box: Box) -> Axes:
    place = (box.x / layout.width, box.y / layout.height, box.width / layout.width, box.height / layout.height)
    axes = figure.add_axes(place)
    axes.tick_params(labelsize=7, length=2.5, pad=2.0)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_fontsize(8)
    axes.xaxis.labelpad = 1.0
    axes.yaxis.set_label_coords(-(LEFT - 13.0) / box.width, 0.5)
    return axes


def _clock(axes: Axes, run: Run, times: np.ndarray) -> Readout:
    """The time, and after a run's end how it ended."""
    trajectory = run.trajectory
    last = trajectory.t[-1]
    ended = f"ended at {last:.2f} s" if trajectory.ok else f"{trajectory.status.name} at {trajectory.status_time:.3g} s"
    over = [time > last + 1e-6 for time in times]
    over[-1] |= not trajectory.ok
    words = [ended if stopped else f"t = {time:.2f} s" for time, stopped in zip(times, over, strict=True)]
    failed = "black" if trajectory.ok else PULLS["edgecolor"]
    return Readout(axes, words, [failed if stopped else "black" for stopped in over])


def _force_readout(axes: Axes, s: Skeleton) -> Readout:
    words = [f"contact force {force:.1f} N" + (": pulls" if force < 0.0 else "") for force in s.force]
    return Readout(axes, words, [PULLS["edgecolor"] if force < 0.0 else PRESSES["facecolor"] for force in s.force])


def _force_limits(group: Sequence[Run]) -> tuple[float, float]:
    """Vertical axis of all force strips [N]."""
    forces = [run.trajectory.constraint_force[:, 0] for run in group]
    low, high = min(0.0, *(f.min() for f in forces)), max(0.0, *(f.max() for f in forces))
    margin = 0.08 * (high - low) or 1.0
    return low - margin, high + margin


def _even(pixels: int) -> int:
    """Next even number: films have even sizes."""
    return pixels + pixels % 2
