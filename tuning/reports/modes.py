"""Report on different failures of a scenario: a line each, and a folder of their scenarios for ``coopmm check``."""

from __future__ import annotations

from pathlib import Path

from coopmm_jax.files import write_csv, write_text
from coopmm_jax.kinds.software import loaded_plugins, record
from coopmm_jax.page import keep_page, write_page
from coopmm_jax.plotting.style import publish
from coopmm_jax.scenario.scenario import Scenario
from tuning.reports.pages import modes_page
from tuning.reports.worst import drawings
from tuning.studies.falsify import said
from tuning.studies.modes import Modes


def write_report(folder: Path, modes: Modes, scenario: Scenario, budget: tuple[int, int]) -> None:
    """Write a scenario file of each failure, failures.csv, a figure of each, and report.html with page.json.

    Args:
        folder: of the results.
        modes: the failures, at least one.
        scenario: that was searched.
        budget: rollouts for each requirement, and starts.
    """
    names = files(modes)
    rows = []
    for name, found, broken in zip(names, modes.found, modes.broken, strict=True):
        write_text(folder / name, record(loaded_plugins()) + found.scenario.to_toml())
        requirement = found.requirement
        robustness = -found.cost * requirement.scale if requirement else ""
        rows.append([name, requirement and requirement.metric, robustness, " ".join(broken), *found.numbers.values()])
    header = ["file", "climbed_against", "robustness", "broken", *modes.found[0].numbers]
    write_csv(folder / "failures.csv", header, rows)
    drawn = drawings(modes.found, scenario)
    publish(folder, {Path(name).with_suffix(".png").name: draw for name, draw in zip(names, drawn, strict=True)})
    page = modes_page(modes, names, scenario, budget)
    keep_page(folder, page)
    write_page(folder, page)


def files(modes: Modes) -> list[str]:
    """Names of the scenario files, in the order of the failures."""
    digits = len(str(len(modes.found)))
    broken = (found.requirement.metric if found.requirement else "cost" for found in modes.found)
    return [f"{i:0{digits}}_{name}.toml" for i, name in enumerate(broken, 1)]


def table(modes: Modes) -> str:
    """A line for each failure, for a terminal."""
    spent = f"{modes.rollouts} rollouts against {', '.join(map(str, modes.searched))}"
    if not modes.found:
        return f"no failure found ({spent})\n"
    lines = []
    for name, found, broken in zip(files(modes), modes.found, modes.broken, strict=True):
        outcome = said(found.requirement, found.cost) if found.requirement else ""
        also = [each for each in broken if found.requirement and each != found.requirement.metric]
        lines.append(f"{name.removesuffix('.toml')}: {outcome}{', also ' + ', '.join(also) if also else ''}")
        lines += [f"    {number} {round(value, 12):.6g}" for number, value in found.numbers.items()]
    return "\n".join([*lines, f"{len(modes.found)} different failures ({spent})"]) + "\n"
