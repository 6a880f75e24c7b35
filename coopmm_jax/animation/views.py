"""Views of an animation: robots from above, arms from the side, contact force over time.

Each view draws once whatever stands still and keeps an artist for everything that moves, so that ``show`` only moves
artists and a frame costs no layout.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from coopmm_jax.animation.scene import CURVE, EDGES, FACES, PRESSES, PULLS, TRAIL, Cast, ForceArrow
from coopmm_jax.animation.skeleton import (
    WHEEL_HALF_THICKNESS,
    Skeleton,
    axle_outline,
    body_outline,
    front_geometry,
    placed,
    wheel_outlines,
)
from coopmm_jax.parameters import Car, Geometry
from coopmm_jax.plotting import lines, style
from coopmm_jax.plotting.curves import guide_curve, platform_curves
from coopmm_jax.plotting.force import hatch_open

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

TRAIL_TIME = 2.5  # [s] of the path behind each robot
HEIGHT = 0.26  # of the object [m]
GROUND = 0.05  # seen below the robots from the side [m]
_ROBOTS = (0, 1)


class TopView:
    """Both robots from above, their desired paths and the object's guide, and crosses at their desired positions."""

    def __init__(self, axes: Axes, run: Trajectory, s: Skeleton, reach: float):
        """
        Args:
            axes: to draw on.
            run: the run.
            s: its skeleton at the frames.
            reach: visible distance from the world's origin to all sides [m].
        """
        self._s = s
        parameters = run.scenario.parameters()
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x [m]", ylabel="y [m]", aspect="equal")
        for points in platform_curves(parameters):
            axes.plot(*points.T, linestyle="-", **CURVE)
        if (points := guide_curve(run.rows, parameters)) is not None:
            axes.plot(*points.T, linestyle=(0, (4, 3)), **CURVE)
        self.cast = cast = Cast(axes)
        self._trails = [cast.line(color=TRAIL[i], linewidth=2.0) for i in _ROBOTS]
        self._outlines = [(*wheel_outlines(g), body_outline(g)) for g in parameters.plant.geometry]
        self._bars = {i: cast.line(color=EDGES[i], linewidth=1.6) for i in _ROBOTS if s.front[i]}
        self._fronts = {i: (cast.platform(i), _front_outlines(parameters.plant.geometry[i])) for i in self._bars}
        self._platforms = [cast.platform(i) for i in _ROBOTS]
        self._names = [cast.text(name, color=EDGES[i]) for i, name in enumerate(("I", "II"))]
        self._object = cast.polygon(facecolor=FACES[2], edgecolor=EDGES[2], linewidth=0.9)
        self._arms = {i: cast.arm(i) for i in (1, 0)}
        self._desired = cast.line(linestyle="", marker="x", markersize=4.5, color="0.25", markeredgewidth=1.0)
        self._arrow = ForceArrow(cast, _usual_force(run))

    def show(self, k: int) -> None:
        """Move everything to frame k."""
        s, behind = self._s, slice(np.searchsorted(self._s.t, self._s.t[k] - TRAIL_TIME), k + 1)
        for i in _ROBOTS:
            midpoint, forward = s.q[k, i, :2], s.forward[k, i]
            for polygon, outline in zip(self._platforms[i], self._outlines[i], strict=True):
                polygon.set_xy(placed(outline, midpoint, forward))
            if (front := s.front[i]) is not None:
                polygons, outlines = self._fronts[i]
                for polygon, outline in zip(polygons, outlines, strict=True):
                    polygon.set_xy(placed(outline, front.midpoint[k], front.forward[k]))
                self._bars[i].set_data(*np.stack([midpoint, front.midpoint[k]]).T)
            self._trails[i].set_data(*s.q[behind, i, :2].T)
            self._arms[i].set_data(*s.joints[k, i, 1:, :2].T)
            nose = self._outlines[i][-1][:, 1].max()
            self._names[i].set_position(midpoint + 0.62 * nose * forward)
        self._desired.set_data(*s.desired[k].T)
        self._object.set_xy(s.joints[k, 1, -1, :2] + s.surface.outline(s.shift[k]) @ s.frame[k])
        self._arrow.show(s.joints[k, 0, -1, :2], s.normal[k], s.force[k])


class SideView:
    """Both robots from the side, seen across arm II; the object stays in the middle, robot I on its left."""

    def __init__(self, axes: Axes, run: Trajectory, s: Skeleton, half_width: float, top: float):
        """
        Args:
            axes: to draw on.
            run: the run.
            s: its skeleton at the frames.
            half_width: visible distance to both sides of the object [m].
            top: visible height above the ground [m].
        """
        self._s = s
        axes.set(xlim=(-half_width, half_width), ylim=(-GROUND, top), aspect="equal")
        axes.set(xlabel="along arm II [m]", ylabel="height [m]")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MultipleLocator(0.5))
        self._geometry = run.scenario.parameters().plant.geometry
        self.cast = cast = Cast(axes)
        self._fronts = {i: cast.platform(i) for i in _ROBOTS if s.front[i]}
        self._platforms = [cast.platform(i) for i in _ROBOTS]
        self._columns = [cast.line(color=EDGES[i], linewidth=5.0, solid_capstyle="butt") for i in _ROBOTS]
        self._object = cast.polygon(facecolor=FACES[2], edgecolor=EDGES[2], linewidth=0.9)
        self._arms = [cast.arm(i) for i in _ROBOTS]
        self._names = [cast.text(name, color=EDGES[i]) for i, name in enumerate(("I", "II"))]
        self._arrow = ForceArrow(cast, _usual_force(run))

    def show(self, k: int) -> None:
        """Move everything to frame k."""
        s, along = self._s, self._s.along[k]
        origin = s.joints[k, 1, -1, :2]
        for i in _ROBOTS:
            places, heights = (s.joints[k, i, :, :2] - origin) @ along, s.joints[k, i, :, 2]
            self._columns[i].set_data(places[:2], heights[:2])
            self._arms[i].set_data(places[1:], heights[1:])
            axle = (s.q[k, i, :2] - origin) @ along
            outlines = _platform_from_the_side(self._geometry[i], s.forward[k, i], along)
            for polygon, outline in zip(self._platforms[i], outlines, strict=True):
                polygon.set_xy(outline + np.array([axle, 0.0]))
            if (front := s.front[i]) is not None:
                ahead = np.array([(front.midpoint[k] - origin) @ along, 0.0])
                outlines = _platform_from_the_side(front_geometry(self._geometry[i]), front.forward[k], along)
                for polygon, outline in zip(self._fronts[i], outlines, strict=True):
                    polygon.set_xy(outline + ahead)
            self._names[i].set_position((axle + 0.25 * np.sign(axle), 0.85 * float(self._geometry[i].r)))
        depth, height = s.surface.outline(s.shift[k])[:, 0], s.joints[k, 1, -1, 2]
        self._object.set_xy(_box(depth.min(), depth.max(), height - HEIGHT / 2, height + HEIGHT / 2))
        tip = s.joints[k, 0, -1]
        contact = np.array([(tip[:2] - origin) @ along, tip[2]])
        self._arrow.show(contact, np.array([s.normal[k] @ along, 0.0]), s.force[k])


class ForceStrip:
    """Contact force over time: its desired value pale, hatched where it pulls, with a mark at the frame's time."""

    def __init__(self, axes: Axes, run: Trajectory, s: Skeleton, limits: tuple[float, float]):
        """
        Args:
            axes: to draw on.
            run: the run.
            s: its skeleton at the frames.
            limits: of the vertical axis [N].
        """
        self._s, self._limits = s, limits
        t, force = lines.samples(run, lambda run: run.constraint_force[:, 0])
        axes.set(xlabel="time [s]", ylabel="force [N]", ylim=limits)
        axes.plot(*lines.samples(run, lambda run: run.constraint_force_desired[:, 0]), **style.REFERENCE)
        axes.plot(t, force, color=PRESSES["facecolor"], linewidth=1.0)
        axes.fill_between(t, force, 0.0, where=force < 0.0, interpolate=True, linewidth=0.6, **PULLS)
        hatch_open(axes, run, linewidth=0.0, **PULLS)
        self.cast = Cast(axes)
        self._now = self.cast.line(color="0.45", linewidth=0.9)
        self._mark = self.cast.line(marker="o", markersize=5.5, markeredgecolor="white")

    def show(self, k: int) -> None:
        """Move the mark to frame k."""
        t, force = self._s.t[k], self._s.force[k]
        self._now.set_data([t, t], self._limits)
        self._mark.set_data([t], [force])
        self._mark.set_color(PULLS["edgecolor"] if force < 0.0 else PRESSES["facecolor"])


def extent(run: Trajectory, s: Skeleton) -> tuple[float, float, float]:
    """Visible distances of a run's views [m]: ``reach`` of the one, ``half_width`` and ``top`` of the other."""
    parameters = run.scenario.parameters()
    geometry = parameters.plant.geometry
    half_track, wheel = max(float(g.l) for g in geometry), max(float(g.r) for g in geometry)
    reach = max(np.abs(s.q[..., :2]).max(), *(np.abs(curve).max() for curve in platform_curves(parameters)))
    from_object = s.q[..., :2] - s.joints[:, 1, None, -1, :2]
    farthest = np.abs((from_object * s.along[:, None]).sum(axis=-1)).max()
    highest = max(s.joints[..., 2].max(), 2.0 * wheel)
    reach += max(float(g.front.wheelbase) if g.front is not None else 0.0 for g in geometry)
    return reach + 1.3 * half_track + 0.1, farthest + half_track + 0.2, highest + 0.2


def _front_outlines(geometry: Geometry) -> list[np.ndarray]:
    """Right and left wheel of a front axle, and its body, from its midpoint along its own axes."""
    ahead = front_geometry(geometry)
    body = axle_outline(ahead) if isinstance(geometry.front, Car) else body_outline(ahead)
    return [*wheel_outlines(ahead), body]


def _usual_force(run: Trajectory) -> float:
    """Contact force that is drawn as an arrow of the usual length: the mean of the desired one [N]."""
    return float(run.constraint_force_desired[:, 0].mean()) if len(run.t) else 0.0


def _platform_from_the_side(geometry: Geometry, forward: np.ndarray, along: np.ndarray) -> list[np.ndarray]:
    """Outlines of the right wheel, the left wheel and the body, from the axle midpoint and the ground."""
    ahead, aside = forward @ along, np.array([forward[1], -forward[0]]) @ along
    r, angle = float(geometry.r), np.linspace(-np.pi / 2.0, np.pi / 2.0, 19)
    half = r * (abs(ahead) * np.cos(angle) + WHEEL_HALF_THICKNESS * abs(aside))
    height = r + r * np.sin(angle)
    wheel = np.stack([np.concatenate([half, -half]), np.concatenate([height, height[::-1]])], axis=-1)
    body = body_outline(geometry) @ (aside, ahead)
    axle = np.array([geometry.l * aside, 0.0])
    return [wheel + axle, wheel - axle, _box(body.min(), body.max(), 0.6 * r, 1.1 * r)]


def _box(left: float, right: float, low: float, high: float) -> np.ndarray:
    return np.array([(left, low), (right, low), (right, high), (left, high)])
