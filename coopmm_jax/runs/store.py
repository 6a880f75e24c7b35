"""The folder of one simulation: ``scenario.toml``, ``trajectory.npz``, ``summary.json`` and ``metrics.csv``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopmm_jax.errors import UserError
from coopmm_jax.files import read_json, read_npz, resolve_path, write_csv, write_json, write_npz, write_text
from coopmm_jax.kinds.software import check_plugins, versions

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory
    from coopmm_jax.scenario.scenario import Scenario


def write_run(folder: Path, scenario: Scenario, trajectory: Trajectory) -> None:
    """Write one simulation: its scenario, ``trajectory.npz`` (arrays by name), ``summary.json`` and ``metrics.csv``."""
    write_text(folder / "scenario.toml", scenario.to_toml())
    arrays = {name: getattr(trajectory, name) for name in trajectory.arrays}
    write_npz(folder / "trajectory.npz", arrays)
    known = scenario.requirements.metrics()
    rows = ([name, repr(value), known[name].unit, known[name].meaning] for name, value in trajectory.metrics.items())
    write_csv(folder / "metrics.csv", ["metric", "value", "unit", "meaning"], rows)
    write_json(folder / "summary.json", summary(scenario, trajectory))


def read_run(folder: str | Path) -> Trajectory:
    """The run that ``write_run`` has written into a folder, as ``coopmm simulate --out`` does.

    Raises:
        UserError: the folder does not hold a run, or one of another version.

    >>> import tempfile
    >>> import coopmm_jax as cm
    >>> run = cm.simulate(cm.load_scenario("paper", simulation={"duration": 0.01}))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_run(Path(folder), run.scenario, run)
    ...     read_run(folder)
    <Trajectory: 11 samples to 0.01 s, float64, OK>
    """
    from coopmm_jax.runs.trajectory import ARRAYS, Trajectory, arrays_of
    from coopmm_jax.scenario.scenario import load_scenario
    from coopmm_jax.status import Status  # imports JAX, as does the next

    folder = resolve_path(folder, "run")
    try:
        arrays, about = read_npz(folder / "trajectory.npz"), read_json(folder / "summary.json")
        check_plugins(about.get("versions", {}), "run", folder)
        scenario = load_scenario(folder / "scenario.toml")
        run = Trajectory(
            **{name: arrays[name] for name in ARRAYS},
            controller={name: arrays[name] for name in arrays_of(scenario) if name not in ARRAYS},
            status=Status[about["status"]],
            status_time=None if about["status_time"] is None else float(about["status_time"]),
            metrics={name: math.nan if value is None else float(value) for name, value in about["metrics"].items()},
            scenario=scenario,
        )
        run.check()
        return run
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise UserError("run", "a folder that coopmm simulate --out has written", f"{folder} ({error})") from None


def summary(scenario: Scenario, trajectory: Trajectory) -> dict[str, Any]:
    """Summary for the reader of a run: its outcome, metrics, settings and software."""
    return {
        "description": scenario.description,
        "status": trajectory.status.name,
        "message": trajectory.status.message,
        "status_time": trajectory.status_time,
        "metrics": dict(trajectory.metrics),
        "scenario": scenario.model_dump(exclude_none=True),
        "versions": versions(),
    }
