"""Each kind of figure is rendered once in a process; building a figure, which is what the project does, always is."""

from pathlib import Path

from matplotlib.figure import Figure


def render_each_kind_once() -> None:
    """Copy the first picture of a name, size and number of artists wherever another such is written to a file.

    Reports draw the same few figures again and again, and laying out and rendering text took a tenth of all the tests'
    time. What figures look like is for the tests of figures, which render to streams and look at what is drawn.
    """
    rendered: dict[tuple, bytes] = {}
    render = Figure.savefig

    def savefig(figure, target, **options):
        if not isinstance(target, str | Path):
            return render(figure, target, **options)
        path = Path(target)
        kind = (path.name, *figure.get_size_inches(), len(figure.findobj()))
        if kind not in rendered:
            render(figure, path, **options)
            rendered[kind] = path.read_bytes()
        path.write_bytes(rendered[kind])
        return None

    Figure.savefig = savefig
