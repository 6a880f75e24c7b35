"""A run, or several side by side, as a moving picture: from above, from the side, and the contact force.

import coopmm_jax as cm

paper, full = (cm.simulate(cm.load_scenario(name)) for name in ("paper", "paper_full"))
cm.animate(paper, full, path="both.gif")
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from coopmm_jax.animation import writers
from coopmm_jax.animation.scene import COLOURS
from coopmm_jax.animation.stage import cuts, stage
from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path, result_folder
from coopmm_jax.memory import check_memory
from coopmm_jax.plotting.lines import longest, runs

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

NARROWEST, WIDEST = 400, 1920  # [pixel]; less is illegible, more takes gigabytes while a GIF is put together
COLUMN = 240  # [pixel] that each of several runs needs
SLOWEST = 0.01  # frames per second; GIFs show no frame for more than eleven minutes
MOST_FRAMES = 100_000
FASTEST = 50.0  # frames per second; browsers slow down GIFs that ask for more


class Animation:
    """The frames of an animation, drawn one at a time: ``len(animation)`` of them, ``animation.picture(k)`` each.

    The background is drawn once; a frame is a copy of it with the moving artists drawn on top.
    """

    def __init__(
        self,
        *trajectories: Trajectory,
        labels: Sequence[str] | None = None,
        fps: float = 25.0,
        speed: float = 1.0,
        width: int = 800,
    ):
        """
        Args:
            trajectories: one, or several to compare.
            labels: one for each trajectory; by default, the settings in which their scenarios differ.
            fps: frames per second.
            speed: simulated seconds per second.
            width: of the picture [pixel], even.

        Raises:
            UserError: nothing to draw, or a number that cannot be used.

        >>> import coopmm_jax as cm
        >>> animation = Animation(cm.simulate(cm.load_scenario("paper", simulation={"duration": 0.2})), width=400)
        >>> len(animation), animation.picture(0).shape[1:]
        (6, (400, 3))
        """
        group = runs(trajectories, labels)
        check_look(fps, speed, width, len(group))
        if not all(len(run.trajectory.t) for run in group):
            raise UserError("trajectories", "runs with at least one sample", "a run that failed at its start")
        self.fps, self.colours, self.cuts = fps, COLOURS, cuts(len(group), width)
        frames = frame_count(float(longest(group).t[-1]), fps, speed, width)
        self.times = np.arange(frames) * speed / fps  # (F,) [s]
        figure, self._views = stage(group, self.times, width)
        self._canvas = FigureCanvasAgg(figure)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(figure.bbox)

    def __len__(self) -> int:
        return len(self.times)

    def picture(self, k: int) -> np.ndarray:
        """Frame k as red, green and blue (height, width, 3), uint8."""
        self._canvas.restore_region(self._still)
        for view in self._views:
            view.show(k)
            for artist in view.cast.artists:
                view.cast.axes.draw_artist(artist)
        return np.array(self._canvas.buffer_rgba())[..., :3]


def animate(
    *trajectories: Trajectory,
    path: str | Path,
    labels: Sequence[str] | None = None,
    fps: float = 25.0,
    speed: float = 1.0,
    width: int = 800,
) -> None:
    """Write an animation; the file is there only when it is complete.

    Args:
        trajectories: one, or several to show side by side.
        path: the file; its suffix decides the format: .gif, .html (one self-contained page), .mp4 (needs ffmpeg).
        labels: one for each trajectory; by default, the settings in which their scenarios differ.
        fps: frames per second.
        speed: simulated seconds per second.
        width: of the picture [pixel], even.

    Raises:
        UserError: nothing to draw, a number that cannot be used, another suffix, no ffmpeg, or a file that cannot be
            written.

    >>> import tempfile
    >>> import coopmm_jax as cm
    >>> run = cm.simulate(cm.load_scenario("paper", simulation={"duration": 0.2}))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     animate(run, path=f"{folder}/run.gif", width=400)
    """
    path = resolve_path(path, "path")
    write = writer(path)
    animation = Animation(*trajectories, labels=labels, fps=fps, speed=speed, width=width)
    with result_folder(path.parent) as folder:
        write(animation, folder / path.name)


def writer(path: Path) -> writers.Writer:
    """Function that writes a file of this name, looked up before any work is done.

    Raises:
        UserError: another suffix than .gif, .html and .mp4, a folder, or .mp4 without ffmpeg.
    """
    if path.suffix.lower() not in writers.WRITERS:
        raise UserError("--out", f"a file that ends in {', '.join(writers.WRITERS)}", path)
    if path.is_dir():
        raise UserError("--out", "a file", f"the folder {path}")
    if path.suffix.lower() == ".mp4":
        writers.find_ffmpeg()
    return writers.WRITERS[path.suffix.lower()]


def check_look(fps: float, speed: float, width: int, count: int = 1) -> None:
    """Check the numbers that an animation is to be drawn with.

    Args:
        fps: frames per second.
        speed: simulated seconds per second.
        width: of the picture [pixel].
        count: number of runs that it shows.

    Raises:
        UserError: a number that cannot be used.
    """
    narrowest = max(NARROWEST, COLUMN * count)
    if not narrowest <= width <= WIDEST or width % 2:
        raise UserError("width", f"an even number of pixels from {narrowest} to {WIDEST}", width)
    if not SLOWEST <= fps <= FASTEST:
        raise UserError("fps", f"from {SLOWEST:g} to {FASTEST:g} frames per second", fps)
    if not 0.0 < speed < np.inf:
        raise UserError("speed", "above 0 simulated seconds per second", speed)


def frame_count(duration: float, fps: float, speed: float, width: int) -> int:
    """Number of frames.

    Args:
        duration: simulated time [s].
        fps: frames per second.
        speed: simulated seconds per second.
        width: of the picture [pixel].

    Raises:
        UserError: more than anyone looks at, or than fit into memory.
    """
    frames = duration * fps / speed + 1.0
    must = "larger, or fps or the duration smaller"
    if not frames <= MOST_FRAMES:
        raise UserError("speed", f"{must} (at most {MOST_FRAMES} frames)", speed)
    check_memory(frames * width**2, "speed", must, speed)  # a byte for each pixel, in pictures wider than high
    return round(frames)
