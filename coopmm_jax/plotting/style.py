"""Look of every figure: sizes, fonts, colours, dashes, legends and files.

Colours are Okabe and Ito's, neighbours differ in lightness, and lines differ in their dashes (the sixth is solid like
the first, but much lighter), so figures can be read in grey and by colour-blind people. Figures are made without
pyplot, so nothing here needs a display or touches global state for longer than one call.

>>> pen(0)["color"] != pen(1)["color"]
True
"""

from __future__ import annotations

import functools
import io
import textwrap
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, ParamSpec, TypeAlias, TypeVar

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from coopmm_jax.errors import Notice, UserError
from coopmm_jax.files import result_folder

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

WIDTH = 6.4  # [inch]
DPI = 150
_NOTEBOOK_DPI = 100

_LEGEND_FONT = 8  # [point]
_TITLED = 120.0  # [point] that a panel has to be high, to have room for a title above its legend
_RC: dict[RcKeyType, Any] = {
    "font.size": 9,
    "hatch.linewidth": 0.6,
    "axes.labelsize": 9,
    "axes.titlesize": 9,
    "legend.fontsize": _LEGEND_FONT,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.xmargin": 0.01,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.useoffset": False,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "legend.columnspacing": 1.2,
    "figure.constrained_layout.use": True,
}
# All other settings are matplotlib's own: a user's may want a program that is not there, LaTeX first of all.
_SETTINGS = ["default", _RC]
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#56B4E9", "#D55E00", "#CC79A7")
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (6, 1.5, 1.5, 1.5)), (0, (1.5, 1)), (0, (9, 3)))
# One look for one meaning, in all figures. What is desired is wide and pale, so that it shows on both sides of a result
# that lies on it.
REFERENCE = {"color": "0.78", "linewidth": 4.0, "zorder": 1.5}
LIMIT = {"color": "0.2", "linewidth": 1.2, "zorder": 1.8}
BEFORE = {"color": "0.35", "linewidth": 1.0, "linestyle": (0, (3, 1, 1, 1))}  # other gains, to compare with
EQUAL = {"color": "0.6", "linewidth": 0.8, "zorder": 1.5}  # where a change would be none
BEYOND: dict[str, Any] = {
    "facecolor": "none",
    "edgecolor": "0.4",
    "hatch": "/////",
    "linewidth": 0.0,
    "zorder": 0.6,
}  # below bars
FAILURE = {"color": "0.3", "linewidth": 2.5, "linestyle": (0, (0.5, 1))}


Arguments = ParamSpec("Arguments")
GivenAxes: TypeAlias = Axes | Iterable[Axes] | None  # to draw on, an array of them as well; None for a new figure
Drawn = TypeVar("Drawn")  # a figure, alone or with what moves in it


class _Picture(Figure):
    """A figure that shows itself in a notebook, where only pyplot's figures would otherwise."""

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        save(self, stream, _NOTEBOOK_DPI)
        return stream.getvalue()


def pen(colour: int, dash: int | None = None) -> dict[str, Any]:
    """Line properties by the number of a colour and of a dash pattern; by default the same number for both."""
    dash = colour if dash is None else dash
    return {"color": _COLOURS[colour % len(_COLOURS)], "linestyle": _DASHES[dash % len(_DASHES)], "linewidth": 1.4}


def styled(draw: Callable[Arguments, Drawn]) -> Callable[Arguments, Drawn]:
    """Run a figure function under this module's settings; those of the user are back when it returns."""

    @functools.wraps(draw)
    def under_settings(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Drawn:
        with matplotlib.style.context(_SETTINGS):
            return draw(*args, **kwargs)

    return under_settings


def panels(
    axes: GivenAxes, layout: Sequence[Sequence[str]], height: float, width: float = WIDTH
) -> tuple[Figure, list[Axes]]:
    """Figure to draw on and its panels, in the order in which their names first appear in ``layout``.

    Args:
        axes: None for a new figure; else the axes to use, one per panel (a single one need not be in a list).
        layout: rows of panel names, as for matplotlib's ``subplot_mosaic``.
        height: of a new figure [inch].
        width: of a new figure [inch].

    Raises:
        UserError: ``axes`` has another number of axes.
    """
    names = list(dict.fromkeys(name for row in layout for name in row))
    if axes is None:
        figure = _Picture(figsize=(width, height))
        by_name = figure.subplot_mosaic([list(row) for row in layout])
        return figure, [by_name[name] for name in names]
    given = [axes] if isinstance(axes, Axes) else list(getattr(axes, "flat", axes))
    usable = len(given) == len(names) and all(isinstance(entry, Axes) for entry in given)
    figure = given[0].get_figure(root=True) if usable else None
    if figure is None:
        raise UserError("axes", f"{len(names)} matplotlib axes, for {', '.join(names)}", f"{len(given)} objects")
    return figure, given


def legend(axes: Axes, handles: Sequence[Artist] | None = None, title: str = "") -> None:
    """Draw a legend above the panel, where it cannot hide data, in as many columns as the panel has room for.

    Args:
        axes: the panel.
        handles: labelled artists; by default all of the panel's.
        title: what the panel shows, above the entries; left out where the panel is low.
    """
    handles = axes.get_legend_handles_labels()[0] if handles is None else handles
    figure = axes.get_figure(root=True)
    if handles and figure is not None:
        widths = [4.5 + 0.52 * len(str(handle.get_label())) for handle in handles]  # [em], estimated, with the handle
        room = axes.get_window_extent().width * 72.0 / figure.dpi / _LEGEND_FONT
        fitting = (n for n in range(len(widths), 1, -1) if sum(map(max, np.array_split(widths, n))) <= room)
        columns = next(fitting, 1)
        look = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.1, "alignment": "left"}
        low = axes.get_window_extent().height * 72.0 / figure.dpi < _TITLED
        wrapped = "" if low else "\n".join(textwrap.wrap(title, max(10, int(0.85 * room / 0.52))))
        axes.legend(handles=handles, ncols=columns, title=wrapped or None, title_fontsize=_LEGEND_FONT, **look)


def plain_numbers(axis: Axis) -> None:
    """Set few and short labels on a logarithmic axis, where matplotlib's own overlap if it spans little.

    >>> plain_numbers(Figure().subplots(subplot_kw={"xscale": "log"}).xaxis)
    """
    low, high = axis.get_view_interval()
    if high < 10.0 * low:
        axis.set_major_locator(MaxNLocator(5))
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)) if 10.0 <= high / low < 1e3 else NullLocator())
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("{x:g}")


def remark(axes: Axes, text: str) -> None:
    """Say in the middle of a panel why it shows nothing.

    >>> remark(Figure().subplots(), "all 64 samples failed")
    """
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color="0.3")


def caption(figure: Figure, text: str) -> None:
    """Write above a figure what it shows.

    >>> caption(Figure(), "What a reader sees first")
    """
    figure.suptitle(text, fontsize=10)


def save(figure: Figure, path: str | Path | BinaryIO, dpi: float = DPI) -> None:
    """Write a figure.

    Args:
        figure: the figure.
        path: a file, whose suffix decides the format (.png, .pdf, .svg), or a stream for PNG.
        dpi: resolution [pixel/inch].

    Raises:
        OSError: the file cannot be written.

    >>> import io
    >>> save(Figure(), io.BytesIO(), dpi=10)
    """
    with matplotlib.style.context(_SETTINGS):
        figure.savefig(path, dpi=dpi)


def publish(target: str | Path, figures: Mapping[str, Callable[[], Figure]], option: str = "--out") -> None:
    """Draw figures and add them to a folder of results; one that fails costs a warning, not the results.

    Args:
        target: folder of the results, which are there already.
        figures: how to draw each, by the name of its file.
        option: what the user knows the folder as, for an error.

    Raises:
        UserError: the folder cannot be written.
    """
    for name, draw in figures.items():
        with result_folder(target, option) as folder:
            try:
                save(draw(), folder / name)
            except Exception as error:
                (Path(target) / name).unlink(missing_ok=True)  # of other results
                warnings.warn(Notice(f"{name} was left out ({type(error).__name__}: {error})"), stacklevel=2)


def plain(text: str) -> str:
    r"""Text that matplotlib shows as it is, for what comes from a user.

    >>> plain("k$_{x$.toml")
    'k\\$_{x\\$.toml'
    """
    return text.replace("$", r"\$")
