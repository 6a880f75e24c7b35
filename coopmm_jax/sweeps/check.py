"""Scenarios of a folder against their own requirements: ``coopmm check``, a regression suite for gains.

Scenarios of one structure run in one batch; what one finds depends on no other.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> strict = load_scenario("paper", requirements={"force_min": ">= 0"})
>>> Checked("paper", strict, Status.OK, np.nan, {"force_min >= 0": -1.0}).kept
False
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.status import Status
from coopmm_jax.sweeps.batch import Device, in_batches
from coopmm_jax.sweeps.engine import naming
from coopmm_jax.sweeps.measure import Horizon, Measured, measure
from coopmm_jax.temporal_logic.sentence import stand_in

SIZE = 32  # of a batch: then the program is the one that a tuning's report has compiled


class Checked(NamedTuple):
    """One scenario's rollout."""

    name: str  # of its file
    scenario: Scenario
    status: Status
    status_time: float  # of a failure [s]; NaN for none
    robustness: dict[str, float]  # of each requirement, in its own unit; of a rollout that fails its stand-in

    @property
    def kept(self) -> bool:
        """True if it completes and every requirement is met."""
        return self.status == Status.OK and all(self.met().values())

    def met(self) -> dict[str, bool]:
        """True for each requirement that is met, in the order of the file."""
        return {name: value >= 0.0 for name, value in self.robustness.items()}


def scenarios_in(folder: Path, changes: Mapping[str, Any]) -> dict[str, Scenario]:
    """Scenario files of a folder by name, in the order of their names.

    Args:
        folder: that has them.
        changes: to each, gains among them.

    Raises:
        UserError: it has none, one has no requirements, or as ``load_scenario``.
    """
    paths = sorted(folder.glob("*.toml"))
    if not paths:
        raise UserError("FOLDER", "a folder with scenario files", folder)
    found = {}
    for path in paths:
        try:
            found[path.stem] = load_scenario(path, **changes)
        except UserError as error:
            raise UserError(f"{path}: {error.field}", error.must, error.was, error.more) from None
        if not found[path.stem].requirements.parsed():
            raise UserError(f"{path}: requirements", "given, so that there is something to check", "empty")
    return found


def check(scenarios: Mapping[str, Scenario]) -> list[Checked]:
    """Roll out every scenario, without its uncertainty, and see how far it is from its requirements.

    Args:
        scenarios: by name.
    """
    groups: dict[Any, list[str]] = {}
    for name, scenario in scenarios.items():
        groups.setdefault(_program(scenario), []).append(name)
    found: dict[str, Checked] = {}
    for names in groups.values():
        measured = _measured([scenarios[name] for name in names], names)
        found |= {name: _checked(name, scenarios[name], measured, row) for row, name in enumerate(names)}
    return [found[name] for name in scenarios]


def _program(scenario: Scenario) -> Any:
    """Key that scenarios share which one batch can take."""
    parameters = scenario.parameters()
    sentences = scenario.requirements.sentences()
    return (_horizon(scenario), scenario.structure(), jax.tree.structure(parameters), sentences)


def _horizon(scenario: Scenario) -> Horizon:
    return Horizon(scenario.sample_time, scenario.steps, scenario.simulation.precision)


def _measured(scenarios: list[Scenario], names: list[str]) -> Measured:
    first = scenarios[0]
    leaves = [jax.tree.leaves(scenario.parameters()) for scenario in scenarios]
    rows = [np.stack([np.asarray(leaf, float) for leaf in column]) for column in zip(*leaves, strict=True)]
    structure = jax.tree.structure(first.parameters())

    def compute(device: Device, picked: np.ndarray) -> Measured:
        parameters = jax.tree.unflatten(structure, [row[picked] for row in rows])
        with naming(f"scenarios {names[picked[0]]} to {names[picked[-1]]}"):
            return measure(first.structure(), _horizon(first), device, parameters, first.requirements.sentences())

    return in_batches(compute, len(scenarios), SIZE)


def _checked(name: str, scenario: Scenario, measured: Measured, row: int) -> Checked:
    status = Status(int(measured.status[row]))
    values = dict(zip(scenario.requirements.metrics(), measured.metrics[row].tolist(), strict=True))
    time = float(measured.status_time[row])
    failed = None if status == Status.OK else stand_in(time / ((scenario.steps + 1) * scenario.sample_time))
    robustness = {
        str(each): float(each.robustness(values[each.metric]) if failed is None else failed) * each.scale
        for each in scenario.requirements.parsed()
    }
    return Checked(name, scenario, status, time, robustness)
