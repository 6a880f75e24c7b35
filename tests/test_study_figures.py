"""Figures of the studies in experiments/, of made-up results."""

import numpy as np

from experiments import controllers
from experiments.benchmarks import tuners


def test_curves_of_tuners_are_the_best_so_far_and_their_median():
    costs = {1: [(1.0, 4.0), (10.0, 2.0)], 2: [(2.0, 6.0), (20.0, 1.0)], 3: [(1.0, 5.0)]}
    rows = [
        tuners.Judgement("shared", tuner, seed, wall, 3.0, cost)
        for tuner in ("coopmm", "random_search")
        for seed, found in costs.items()
        for wall, cost in found
    ]
    figure = tuners.curves(rows)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    *seeds, median = axes.lines[:4]
    assert [line.get_ydata()[[0, -1]].tolist() for line in seeds] == [[4.0, 2.0], [6.0, 1.0], [5.0, 5.0]]
    assert median.get_ydata()[[0, -1]].tolist() == [5.0, 2.0]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["coopmm", "random search"]


def test_controllers_are_compared_over_the_uncertainty():
    def row(scenario, factor, controller, met):
        return controllers.Row(scenario, factor, controller, 1.0, 2.0, 0, met, 10, 0, 0, 1.0, (0.1 * factor,) * 5)

    rows = [
        row(scenario, factor, controller, met - int(factor))
        for scenario in ("sensed", "rough")
        for factor in controllers.FACTORS
        for controller, met in (("pid", 4), ("robust_adaptive", 9))
    ]
    figure = controllers.picture(rows)
    figure.draw_without_rendering()
    assert [axes.get_title() for axes in figure.axes] == ["sensed", "rough", "", ""]
    for axes in figure.axes[:2]:
        np.testing.assert_allclose([line.get_ydata() for line in axes.lines], [[0.3, 0.2, 0.0], [0.8, 0.7, 0.5]])
        np.testing.assert_array_equal(axes.lines[0].get_xdata(), controllers.FACTORS)
    for axes in figure.axes[2:]:
        np.testing.assert_allclose([line.get_ydata() for line in axes.lines], [[0.1, 0.2, 0.4]] * 2)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["pid", "robust_adaptive"]
