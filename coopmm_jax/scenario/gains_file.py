"""Gains in a file of their own: what ``coopmm tune`` writes and ``--gains-file`` reads.

>>> from coopmm_jax.kinds.robust_adaptive import Gains
>>> gains_text(Gains(k0=3.0)).splitlines()[:2]
['[law]', 'controller = "robust_adaptive"']
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import tomli_w

from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path
from coopmm_jax.kinds.controllers import name_of
from coopmm_jax.kinds.software import check_plugins, loaded_plugins, record, recorded_plugins
from coopmm_jax.parameters import PhaseSchedule, Schedule
from coopmm_jax.scenario.overrides import merged, read_toml
from coopmm_jax.scenario.scenario import load_scenario
from coopmm_jax.scenario.sections.controller import gain_tables
from coopmm_jax.scenario.sections.schedule import schedule_table

GAINS_FILE, RUN_FILE = "gains.toml", "trajectory.npz"  # of a tuning, of a run
_SECTIONS = ("gains", "law", "schedule")


def gains_text(gains: Any, schedule: Schedule | PhaseSchedule | None = None) -> str:
    """TOML of the controller and every gain of it, in the sections of a scenario; plugins that are loaded above it."""
    table = schedule_table(schedule) if schedule else {}
    given = {name: value for name, value in table.items() if value != "none"}
    tables = merged({"law": {"controller": name_of(gains)}}, gain_tables(gains))
    return record(loaded_plugins()) + tomli_w.dumps(tables | ({"schedule": given} if given else {}))


def read_gains(path: str | Path) -> dict[str, Any]:
    """The tables of a gains file, to be laid over a scenario: what it says holds, whatever schedule the scenario has.

    Args:
        path: of the file, or of a folder that has one: ``coopmm tune --out``, or a run's, whose own gains are meant.

    Raises:
        UserError: a file that cannot be read, or that holds anything but [gains], [law] and [schedule]; one that was
            made with plugins that are not loaded; a folder without gains.
    """
    tables = _tables(path)
    others = [name for name in tables if name not in _SECTIONS]
    if others or "gains" not in tables:
        raise UserError(
            "--gains-file", "a file of [gains], [law] and [schedule]", f"{path} with {', '.join(tables) or 'nothing'}"
        )
    return tables | {"schedule": schedule_table(None) | tables.get("schedule", {})}


def _tables(path: str | Path) -> dict[str, Any]:
    place = resolve_path(path, "--gains-file")
    if not place.is_dir():
        return _of_file(place)
    if (place / GAINS_FILE).exists():
        return _of_file(place / GAINS_FILE)
    if not (place / RUN_FILE).exists():  # a search that has not ended has the scenario's old gains alone
        must = f"a file of gains, or a folder with {GAINS_FILE} or with a run"
        raise UserError("--gains-file", must, f"{path}, a folder with neither")
    parameters = load_scenario(place / "scenario.toml").parameters()
    return tomllib.loads(gains_text(parameters.gains, parameters.schedule))


def _of_file(file: Path) -> dict[str, Any]:
    tables = read_toml(file, "--gains-file")
    check_plugins(recorded_plugins(file.read_text(encoding="utf-8-sig")), "--gains-file", file)
    return tables
