"""Parts of an animation's views: colours, moving artists, the contact force as an arrow."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.text import Text

from coopmm_jax.plotting import style

EDGES = tuple(style.pen(k)["color"] for k in range(3))  # robot I, robot II, object
FACES = ("#A9D0EA", "#F9DCA6", "#8FD6BE")
TRAIL = ("#7DB8DC", "#F2C46B")
WHEEL = {"facecolor": "0.4", "edgecolor": "0.2", "linewidth": 0.6}
CURVE = {"color": "0.8", "linewidth": 1.2}
PRESSES = {"facecolor": "black", "edgecolor": "white", "hatch": None}
PULLS = {"facecolor": "#FFE3D3", "edgecolor": style.pen(4)["color"], "hatch": "////////"}
_AREAS = to_rgba_array(("white", *FACES, *TRAIL, WHEEL["facecolor"], WHEEL["edgecolor"], PULLS["facecolor"]))
_INKS = to_rgba_array(("black", *EDGES, PULLS["edgecolor"]))
_EDGES_OF_INK = [1.0 - part * (1.0 - _INKS) for part in (0.7, 0.35)]  # at a line's edge ink covers part of a pixel
# Red, green and blue (n, 3), uint8, of the colours that a picture with few colours has to keep.
COLOURS = (255.0 * np.concatenate([_AREAS, _INKS, *_EDGES_OF_INK])[:, :3]).round().astype(np.uint8)

ARROW = 0.5  # [m] for the desired contact force
LONGEST_ARROW = 1.3  # [m]; beyond it only the number tells how large the force is
FALLBACK_FORCE = 15.0  # [N] of an arrow of that length where no force is desired
_HEAD = np.array([(-0.22, 0.13), (0.0, 0.0), (-0.22, -0.13)])  # ahead and aside of the arrow's point [m]
_SHAFT = 0.05  # half width [m]


class Cast:
    """Moving artists of one view, in the order in which they are drawn."""

    def __init__(self, axes: Axes):
        self.axes = axes
        self.artists: list[Artist] = []

    def polygon(self, **look: Any) -> Polygon:
        """Add a polygon, still without a shape."""
        polygon = Polygon(np.zeros((3, 2)), closed=True, animated=True, joinstyle="round", **look)
        self.artists.append(self.axes.add_patch(polygon))
        return polygon

    def line(self, **look: Any) -> Line2D:
        """Add a line, still without points."""
        round_ends: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
        line = Line2D([], [], animated=True, **round_ends | look)
        self.artists.append(self.axes.add_line(line))
        return line

    def text(self, text: str, **look: Any) -> Text:
        """Add a centred name, still without a place."""
        name = {"ha": "center", "va": "center", "fontsize": 7, "fontweight": "bold", "clip_on": True}
        artist = self.axes.text(0.0, 0.0, text, animated=True, **name | look)
        self.artists.append(artist)
        return artist

    def platform(self, robot: int) -> tuple[Polygon, Polygon, Polygon]:
        """Add right wheel, left wheel and body of a platform."""
        body = {"facecolor": FACES[robot], "edgecolor": EDGES[robot], "linewidth": 0.9}
        return self.polygon(**WHEEL), self.polygon(**WHEEL), self.polygon(**body)

    def arm(self, robot: int) -> Line2D:
        """Add the links of an arm, with their joints."""
        look = {"color": EDGES[robot], "markerfacecolor": "white", "markeredgewidth": 1.0}
        return self.line(linewidth=3.2, marker="o", markersize=4.0, **look)


class ForceArrow:
    """Contact force on the object as an arrow: black where it presses, hatched in another colour where it pulls."""

    def __init__(self, cast: Cast, desired: float):
        """
        Args:
            cast: of the view to draw in.
            desired: contact force drawn at the usual length [N].
        """
        self._polygon = cast.polygon(linewidth=0.8)
        self._scale = ARROW / abs(desired or FALLBACK_FORCE)

    def show(self, contact: np.ndarray, direction: np.ndarray, force: float) -> None:
        """Put the arrow's tail on the contact point.

        Args:
            contact: place in the view (2,) [m].
            direction: of a pressing force in the view (2,), of length 1 at most.
            force: lambda_n [N].
        """
        self._polygon.set(**(PULLS if force < 0.0 else PRESSES))
        length = min(self._scale * abs(force), LONGEST_ARROW)
        self._polygon.set_xy(arrow(contact, np.sign(force) * direction, length))


def arrow(tail: np.ndarray, direction: np.ndarray, length: float) -> np.ndarray:
    """Outline (7, 2) [m] of an arrow; one too short for its head is scaled down as a whole.

    >>> arrow(np.zeros(2), np.array([1.0, 0.0]), 1.0)[3].tolist()
    [1.0, 0.0]
    """
    size = min(1.0, length / 0.3)
    ahead, shaft = length + size * _HEAD[0, 0], size * _SHAFT
    (_, wide), *_ = size * _HEAD
    along = [0.0, ahead, ahead, length, ahead, ahead, 0.0]
    aside = [shaft, shaft, wide, 0.0, -wide, -shaft, -shaft]
    across = np.array([-direction[1], direction[0]])
    return tail + np.outer(along, direction) + np.outer(aside, across)
