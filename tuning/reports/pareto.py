"""Report on a front between quality and effort: a table, gains files, a figure.

    coopmm tune sensed --pareto 5 --out front

prints ``table`` and writes front.txt, front.csv, front.png, report.html and gains_01.toml, gains_02.toml, ...
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.files import write_csv, write_text
from coopmm_jax.page import keep_page, write_page
from coopmm_jax.plotting.style import GivenAxes, legend, panels, pen, plain_numbers, publish, styled
from coopmm_jax.scenario.gains_file import gains_text
from tuning.cost.objective import FAILED
from tuning.reports.pages import front_page, weight_text
from tuning.studies.pareto import Front

TABLE = "front.csv"
_START = "start"  # where others have the name of a gains file


def clear(folder: Path) -> None:
    """Remove a front, so that no gains of it can be taken for a part of the next."""
    for path in (folder / TABLE, *folder.glob("gains_[0-9][0-9].toml")):
        path.unlink(missing_ok=True)


def write_report(folder: Path, front: Front) -> None:
    """Write a gains file for each weighting, front.txt, front.csv and front.png, and report.html with its page.json."""
    for name, gains, schedule in zip(_names(front)[1:], front.gains, front.schedules, strict=True):
        write_text(folder / name, gains_text(gains, schedule))
    write_text(folder / "front.txt", table(front))
    rows = _rows(front)
    write_csv(folder / TABLE, list(rows[0]), (row.values() for row in rows))
    publish(folder, {"front.png": lambda: picture(front)})
    page = front_page(front, rows)
    keep_page(folder, page)
    write_page(folder, page)


def table(front: Front) -> str:
    """Front as text: quality and effort of the start and of every weighting, on untouched samples."""
    samples, duration = front.scenario.tuning.test_samples, front.scenario.simulation.duration
    lines = [f"{samples} untouched samples of {duration:g} s; small is good, about 1 under the scenario's gains", ""]
    lines.append(f"{'':14} {'weight of effort':>16} {'quality':>12} {'effort':>12}")
    for row in _rows(front):
        weight = weight_text(row)
        remark = "   dominated" if row["dominated"] else ""
        lines.append(f"{row['gains']:14} {weight:>16} {row['quality']:12.5g} {row['effort']:12.5g}{remark}")
    return "\n".join(lines) + "\n"


@styled
def picture(front: Front, axes: GivenAxes = None) -> Figure:
    """Quality over effort: the front on untouched samples and on those that chose it, the start, all gains tried.

    Args:
        front: the front.
        axes: matplotlib axes to draw on.
    """
    figure, (panel,) = panels(axes, [["front"]], height=4.0)
    tried = front.tried[np.all(front.tried < FAILED * 1e-3, axis=1)]
    panel.plot(tried[:, 1], tried[:, 0], ".", color="0.8", markersize=4, label="tried (validation)")
    panel.plot(front.validation[1:, 1], front.validation[1:, 0], "x", color="0.35", label="chosen (validation)")
    points, good = front.points[1:], ~front.dominated
    chain = points[good][np.argsort(points[good, 1], kind="stable")]
    colour = pen(0)["color"]
    panel.plot(chain[:, 1], chain[:, 0], "o-", color=colour, linewidth=1.2, label="untouched samples")
    if not good.all():
        panel.plot(points[~good, 1], points[~good, 0], "o", color=colour, mfc="white", label="the same, dominated")
    panel.plot(*front.points[0, ::-1], "s", color=pen(4)["color"], markersize=7, label="scenario's gains")
    _name_points(panel, front)
    panel.set(xscale="log", yscale="log", xlabel="effort [-]", ylabel="quality: errors of tracking and force [-]")
    plain_numbers(panel.xaxis)
    plain_numbers(panel.yaxis)
    legend(panel)
    return figure


def _name_points(panel: Axes, front: Front) -> None:
    """Write the weight beside each point; weightings that end in the same gains share one label."""
    shared: dict[tuple[float, float], list[str]] = {}
    for weight, (quality, effort) in zip(front.weights, front.points[1:], strict=True):
        shared.setdefault((effort, quality), []).append(f"{weight:.2g}")
    for place, weights in shared.items():
        panel.annotate(", ".join(weights), place, xytext=(5, 4), textcoords="offset points", fontsize=8)


def _names(front: Front) -> list[str]:
    return [_START, *(f"gains_{i:02d}.toml" for i in range(1, len(front.weights) + 1))]


def _rows(front: Front) -> list[dict[str, Any]]:
    """Lines of the table, the start first."""
    return [
        {
            "gains": name,
            "weight": float(front.weights[i - 1]) if i else "",
            "quality": float(front.points[i, 0]),
            "effort": float(front.points[i, 1]),
            "validation_quality": float(front.validation[i, 0]),
            "validation_effort": float(front.validation[i, 1]),
            "dominated": int(front.dominated[i - 1]) if i else 0,
            **dict(zip(front.labels, front.values[i].tolist(), strict=True)),
        }
        for i, name in enumerate(_names(front))
    ]
