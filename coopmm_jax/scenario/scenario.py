"""Scenario: everything one simulation depends on, from a TOML file to the pytrees of ``parameters.py``.

>>> scenario = load_scenario("paper", gains={"K_lambda": 2.0})
>>> scenario.parameters().gains.K_lambda
(2.0, 2.0, 2.0, 2.0)
"""

from __future__ import annotations

import functools
import os
from importlib import resources
from pathlib import Path
from typing import Any, Self

from pydantic import model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path
from coopmm_jax.kinds.plugins import load_installed
from coopmm_jax.kinds.software import check_plugins, recorded_plugins
from coopmm_jax.scenario.base import BaseScenario
from coopmm_jax.scenario.overrides import laid_over, merged, read_toml
from coopmm_jax.scenario.validation import closest, validate

_ROBOTS = {"plant", "platform", "arm"}


class Scenario(BaseScenario):
    """A complete, valid scenario, in which everything uncertain can vary as it says; immutable and hashable."""

    @model_validator(mode="after")
    def _what_varies_can(self) -> Self:
        if self.uncertainty.entries():
            from coopmm_jax.scenario.variation import check, vary  # imports NumPy, which few scenarios need

            check(vary(self))
        return self


def load_scenario(name_or_path: str | Path, **overrides: Any) -> Scenario:
    """Shipped scenario by name, or scenario file by path, with some fields changed.

    A description is of the robots that it was written for: a file that gives none, and a change of the robots, is one
    "Based on" what it begins from.

    Args:
        name_or_path: a name from ``list_scenarios()``, or the path of a TOML file.
        overrides: sections, as tables of the fields to change: ``gains={"K_lambda": 2.0}``.

    Raises:
        UserError: no such scenario, a file that is not TOML, an unknown field, or a value it cannot have.

    >>> load_scenario("paper").steps
    20000
    """
    load_installed()
    path = _find(str(name_or_path), Path(), "scenario")
    tables, changed = _read(path), {str(name).partition(".")[0] for name in overrides}
    if changed & _ROBOTS:
        overrides = {"description": based_on(path)} | overrides
    try:
        return validate(Scenario, laid_over(tables, overrides))
    except UserError:
        # What a missing plugin would explain is told first.
        check_plugins(recorded_plugins(path.read_text(encoding="utf-8-sig")), "scenario", path)
        raise


def based_on(name_or_path: str | Path) -> str:
    """Description of a scenario that begins from another one and has none of its own.

    >>> based_on("robots/mine.toml")
    'Based on mine'
    """
    return f"Based on {Path(name_or_path).stem}"


def list_scenarios() -> dict[str, str]:
    """Shipped scenarios: name -> one line of description.

    Raises:
        UserError: the file of one cannot be read.

    >>> "paper" in list_scenarios()
    True
    """
    return {name: _read(path).get("description", "") for name, path in sorted(shipped().items())}


def shipped() -> dict[str, Path]:
    """Files of the shipped scenarios by name."""
    folder = Path(str(resources.files("coopmm_jax"))) / "scenarios"
    return {path.stem: path for path in folder.glob("*.toml")}


def _find(name_or_path: str, folder: Path, field: str) -> Path:
    """File that a name, or a path relative to ``folder``, stands for, as ``field`` of the input gives it."""
    files = shipped()
    if name_or_path in files:
        return files[name_or_path]
    path = folder / resolve_path(name_or_path, field)
    if path.suffix == ".toml" or path.is_file():
        return path
    names = ", ".join(sorted(files))
    raise UserError(field, f"one of {names} or a .toml file{closest(name_or_path, files)}", name_or_path)


def _read(path: Path) -> dict[str, Any]:
    """Tables of a scenario file, laid over those of its ``base``, and so on."""
    field, laid, seen = "scenario", [], set()
    while True:
        tables = read_toml(path, field)
        if os.path.realpath(path) in seen:
            raise UserError("base", "a scenario that does not inherit from this one", path)
        seen.add(os.path.realpath(path))
        base, field = tables.pop("base", None), "base"
        if not isinstance(base, str | None):
            raise UserError("base", "the name or path of a scenario", base)
        own = tables if base is None else {"description": based_on(base)} | tables
        laid.append(_found_from(path.parent, merged({}, own)))
        if base is None:
            return functools.reduce(laid_over, reversed(laid), {})
        path = _find(base, path.parent, "base")


def _found_from(folder: Path, tables: dict[str, Any]) -> dict[str, Any]:
    """Tables of a file in a folder, with every field ``file`` as a path that means the same from anywhere."""

    def found(key: str, value: Any) -> Any:
        if isinstance(value, dict):
            return _found_from(folder, value)
        if isinstance(value, list):
            return [found(key, entry) for entry in value]
        plain = key == "file" and isinstance(value, str) and value
        return str((folder / resolve_path(value, key)).absolute()) if plain else value

    return {key: found(key, value) for key, value in tables.items()}
