"""Boxes of a figure's panels with their labels, as a user's figure has them."""

from matplotlib.backends.backend_agg import FigureCanvasAgg

from coopmm_jax.plotting import style


@style.styled
def outlines(figure, rendered=False):
    """Boxes of all panels with their labels, after the layout, which is half of what rendering takes."""
    if rendered:
        FigureCanvasAgg(figure).draw()
    else:
        figure.get_layout_engine().execute(figure)
    return [axes.get_tightbbox() for axes in figure.axes]
