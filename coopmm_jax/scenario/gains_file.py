"""Gains in a file of their own: what ``coopmm tune`` writes and ``--gains-file`` reads.

>>> from coopmm_jax.parameters import Gains
>>> gains_text(Gains(k0=3.0)).splitlines()[:2]
['[law]', 'controller = "robust_adaptive"']
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import tomli_w

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import name_of
from coopmm_jax.parameters import Schedule
from coopmm_jax.scenario.overrides import merged, read_toml
from coopmm_jax.scenario.sections.controller import gain_tables
from coopmm_jax.scenario.sections.schedule import schedule_table

_SECTIONS = ("gains", "law", "schedule")


def gains_text(gains: Any, schedule: Schedule | None = None) -> str:
    """TOML of the controller and every gain of it, in the sections that a scenario has them in."""
    table = schedule_table(schedule) if schedule else {}
    given = {name: value for name, value in table.items() if value != "none"}
    tables = merged({"law": {"controller": name_of(gains)}}, gain_tables(gains))
    return tomli_w.dumps(tables | ({"schedule": given} if given else {}))


def read_gains(path: str | Path) -> dict[str, Any]:
    """The tables of a gains file, to be laid over a scenario: what it says holds, whatever schedule the scenario has.

    Raises:
        UserError: a file that cannot be read, or that holds anything but [gains], [law] and [schedule].
    """
    tables = read_toml(path, "--gains-file")
    others = [name for name in tables if name not in _SECTIONS]
    if others or "gains" not in tables:
        raise UserError(
            "--gains-file", "a file of [gains], [law] and [schedule]", f"{path} with {', '.join(tables) or 'nothing'}"
        )
    return tables | {"schedule": schedule_table(None) | tables.get("schedule", {})}
