"""Result folders: what is in them, and that they are either complete or not there.

>>> import tempfile
>>> with tempfile.TemporaryDirectory() as parent:
...     with result_folder(Path(parent) / "run") as folder:
...         _ = (folder / "summary.json").write_text("{}")
...     sorted(path.name for path in (Path(parent) / "run").iterdir())
['summary.json']
"""

from __future__ import annotations

import json
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from coopmm_jax.errors import UserError

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory
    from coopmm_jax.scenario.scenario import Scenario


@contextmanager
def result_folder(target: str | Path, option: str = "--out") -> Iterator[Path]:
    """A folder to write results into; they appear in ``target`` only when the ``with`` block ends without an exception.

    Entering it already creates a hidden folder beside the target, so an unusable target is found before a long
    run, not after. In a target that exists, files of the same name are replaced and others left alone.

    Args:
        target: the folder the results are for; its parents are made as needed.
        option: what the user knows the target as, for the error.

    Yields:
        A folder inside the hidden one.

    Raises:
        UserError: the target cannot be written.
    """
    target = Path(target).expanduser().absolute()
    try:
        hidden = _hidden_folder(target)
    except OSError as error:
        raise UserError(option, "a folder that can be written", f"{target} ({error.strerror})") from None
    try:
        results = hidden / "results"  # with the user's usual permissions, which the hidden folder does not have
        results.mkdir()
        yield results
        _publish(results, target)
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def write_run(folder: Path, scenario: Scenario, trajectory: Trajectory) -> None:
    """Write one simulation: ``scenario.toml``, ``trajectory.npz`` (its arrays by name) and ``summary.json``."""
    (folder / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
    arrays = {name: value for name, value in vars(trajectory).items() if isinstance(value, np.ndarray)}
    np.savez(folder / "trajectory.npz", **arrays)
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
    from coopmm_jax.runs.trajectory import ARRAYS, Trajectory
    from coopmm_jax.scenario.scenario import load_scenario
    from coopmm_jax.status import Status  # imports JAX, as does the next

    folder = Path(folder).expanduser()
    try:
        with np.load(folder / "trajectory.npz") as saved:
            arrays = {name: saved[name] for name in ARRAYS}
        about = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        return Trajectory(
            **arrays,
            status=Status[about["status"]],
            status_time=about["status_time"],
            metrics={name: math.nan if value is None else value for name, value in about["metrics"].items()},
            scenario=load_scenario(folder / "scenario.toml"),
        )
    except (OSError, KeyError, ValueError, BadZipFile) as error:
        raise UserError("run", "a folder that coopmm simulate --out has written", f"{folder} ({error})") from None


def summary(scenario: Scenario, trajectory: Trajectory) -> dict[str, Any]:
    """What a reader of the results asks first: how it ended, the metrics, the settings, the software."""
    return {
        "description": scenario.description,
        "status": trajectory.status.name,
        "message": trajectory.status.message,
        "status_time": trajectory.status_time,
        "metrics": dict(trajectory.metrics),
        "scenario": scenario.model_dump(exclude_none=True),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide a result's digits."""
    packages = ("coopmm_jax", "jax", "jaxlib", "numpy")
    return {"python": platform.python_version(), **{package: version(package) for package in packages}}


def write_json(path: Path, content: Any) -> None:
    """Write strict JSON: numpy's numbers as numbers, what is not finite as null."""
    path.write_text(json.dumps(_plain(content), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _hidden_folder(target: Path) -> Path:
    """A folder on the target's file system: inside the target if it exists, else in its nearest existing parent."""
    place = target
    while not place.exists():
        place = place.parent
    return Path(tempfile.mkdtemp(prefix=f".{target.name}-", suffix=".partial", dir=place))


def _publish(results: Path, target: Path) -> None:
    if target.exists():
        for path in sorted(path for path in results.rglob("*") if path.is_file()):
            final = target / path.relative_to(results)
            final.parent.mkdir(parents=True, exist_ok=True)
            os.replace(path, final)
    else:
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(results, target)
