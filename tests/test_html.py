"""Result of a tuning as a notebook shows it."""

import numpy as np

from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.status import Status
from tuning.studies.chatter import Slopes
from tuning.studies.comparison import Comparison
from tuning.studies.margins import Margin
from tuning.studies.result import Row, TuningResult


def test_html_tells_costs_requirements_and_gains():
    changes = {"description": "<b>a & b", "requirements": {"force_min": ">= 0"}}
    metrics = {"force_min": np.array([[-1.0, -1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]])}
    status = np.array([[Status.OK] * 4, [Status.OK] * 3 + [Status.SPEED]])
    costs = np.array([[4.0, 2.0, 2.0, 4.0], [2.0, 1.0, 1.0, 2.0]])
    comparison = Comparison(costs, np.ones((2, 4, 9)), metrics, status, np.zeros(1), {})
    history = [Row(i, "searching", 1.0, 1.0, 0, 0, 0.0) for i in range(3)]
    scenario = load_scenario("paper", **changes)
    margins = [Margin(name, 1.0, 0.5, 2.0, "cost", "free") for name in ("K_a", "k1")]
    before, after = np.array([1.0, 180.0]), np.array([2.5, 90.0])
    result = TuningResult(
        scenario, ["K_a", "k1"], before, after, comparison, margins, Slopes(1.0, 1.0, 0.0), [], history
    )
    page = result._repr_html_()
    assert "<b>TuningResult: 2 numbers, 2 iterations, 4 untouched samples</b><br>&lt;b&gt;a &amp; b" in page
    assert "<td>cost, mean</td><td>3</td><td>1.5</td><td>ratio 0.5 to 0.5 (95 %)</td>" in page
    assert "<td>force_min &gt;= 0</td><td>0.500</td><td>0.750</td><td>success probability</td>" in page
    assert "<td>K_a</td><td>1</td><td>2.5</td>" in page
    assert page.count("<tr>") == page.count("</tr>") == (1 + 4) + (1 + 2)
