"""Pictures that commands write in tests are blank; building a figure, which is what the project does, always is done.

Laying out and rendering text took a tenth of all the tests' time, for files that no test looks at. What figures look
like is for the tests of figures: they draw, or have files rendered as users get them.
"""

import contextlib
import functools
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from PIL import Image


def leave_pictures_blank(streams: bool = False) -> None:
    """Write a blank picture of the same size wherever a figure is saved as a PNG file.

    Args:
        streams: leave pictures blank that notebooks show, too; otherwise streams get the figure.
    """
    render = Figure.savefig

    @functools.wraps(render)
    def savefig(figure, target, **options):
        if Path(target).suffix == ".png" if isinstance(target, str | Path) else streams:
            size = figure.get_size_inches() * options.get("dpi", figure.dpi)
            Image.new("1", tuple(int(pixels) for pixels in size), "white").save(target, "PNG")
        else:
            render(figure, target, **options)

    Figure.savefig = savefig


@contextlib.contextmanager
def rendering():
    """Render pictures as users get them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", Figure.savefig.__wrapped__)
        yield
