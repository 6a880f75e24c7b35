"""Scenario: everything one simulation depends on, from a TOML file to the pytrees of ``parameters.py``.

>>> scenario = load_scenario("paper", gains={"K_lambda": 2.0})
>>> scenario.parameters().gains.K_lambda
(2.0, 2.0, 2.0, 2.0)
"""

from __future__ import annotations

import functools
import os
from collections.abc import Collection, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.parameters import (
    Disturbance,
    Geometry,
    Inertia,
    Parameters,
    Plant,
    Pose,
    Reference,
    Structure,
    Surface,
)
from coopmm_jax.scenario.overrides import merged, read_toml
from coopmm_jax.scenario.sections.controller import (
    GainsSection,
    LawSection,
    NominalSection,
    ReferenceSection,
    full_gains,
)
from coopmm_jax.scenario.sections.hardware import HardwareSections
from coopmm_jax.scenario.sections.plant import CouplingSection, DisturbanceSection, InitialSection, PlantSection
from coopmm_jax.scenario.sections.requirements import RequirementsSection
from coopmm_jax.scenario.sections.simulation import SimulationSection
from coopmm_jax.scenario.sections.tuning import TuningSection
from coopmm_jax.scenario.sections.uncertainty import UncertaintySection
from coopmm_jax.scenario.validation import closest, validate


class Scenario(HardwareSections):
    """A complete, valid scenario; immutable and hashable. The defaults are the paper's section IV."""

    description: str = ""
    simulation: SimulationSection = SimulationSection()
    plant: PlantSection = PlantSection()
    coupling: CouplingSection = CouplingSection()
    nominal: NominalSection = NominalSection()
    law: LawSection = LawSection()
    gains: GainsSection = GainsSection()
    disturbance: DisturbanceSection = DisturbanceSection()
    reference: ReferenceSection = ReferenceSection()
    initial: InitialSection = InitialSection()
    uncertainty: UncertaintySection = UncertaintySection()
    requirements: RequirementsSection = RequirementsSection()
    tuning: TuningSection = TuningSection()

    @property
    def steps(self) -> int:
        """Number of samples after the first: integration steps, or control periods where the loop is sampled."""
        return round(self.simulation.duration / self.sample_time)

    @property
    def sample_time(self) -> float:
        """Time between samples [s]: the integration step, or the control period where the loop is sampled."""
        return self.loop.control_period or self.simulation.step

    def with_overrides(self, changes: Mapping[str, Any]) -> Scenario:
        """A copy with some fields changed: ``scenario.with_overrides({"gains.K_lambda": 2})``.

        Args:
            changes: nested tables, or dotted names, to values.

        Raises:
            UserError: an unknown field, or a value it cannot have.
        """
        return validate(Scenario, merged(self.model_dump(exclude_none=True), changes))

    def to_toml(self) -> str:
        """The text of a scenario file that loads as an equal scenario, with every value spelt out."""
        return tomli_w.dumps(self.model_dump(exclude_none=True))

    def structure(self, varied: Collection[str] = ()) -> Structure:
        """The choices that change the equations themselves.

        Args:
            varied: fields ("sensing.force_lag") that an uncertainty changes, whose effects must be in force.
        """
        law = self.law
        return Structure(
            self.coupling.rows,
            law.robust_term,
            law.u26,
            law.feedforward,
            substeps=self.loop.substeps(self.simulation),
            force_delay=self.sensing.force_delay,
            features=self.features(varied),
        )

    def parameters(self) -> Parameters:
        """Everything numeric, as Python floats in the pytree that a rollout takes."""
        return Parameters(
            plant=self._plant(),
            nominal=self._nominal(),
            gains=full_gains(dict(self), len(self.coupling.rows)),
            disturbance=Disturbance(**dict(self.disturbance)),
            reference=self._reference(),
            start=_per_robot(Pose, dict(self.initial)),
            hardware=self.hardware(self.simulation.seed, self.simulation.stream),
        )

    def _plant(self) -> Plant:
        values, coupling = dict(self.plant), self.coupling
        surface = Surface(coupling.contact_radius, coupling.guide_radius, coupling.guide_height)
        return Plant(_per_robot(Geometry, values), _inertias(values), surface, self.plant.gravity)

    def _nominal(self) -> tuple[Inertia, Inertia]:
        plant = {name: _scaled(getattr(self.plant, name), self.nominal.scale) for name in Inertia._fields}
        given = {name: value for name, value in self.nominal if name != "scale" and value is not None}
        return _inertias(plant | given)

    def _reference(self) -> Reference:
        values = dict(self.reference)
        return Reference(**values | {name: _spread(values[name], 2) for name in ("radius", "arm_centre", "arm_swing")})

    @model_validator(mode="after")
    def _whole_control_periods(self) -> Scenario:
        self.loop.substeps(self.simulation)
        return self

    @model_validator(mode="after")
    def _numbers_of_gains(self) -> Scenario:
        full_gains(dict(self), len(self.coupling.rows))
        return self

    @model_validator(mode="after")
    def _what_is_required_is_measured(self) -> Scenario:
        for metric in self.requirements.__pydantic_extra__:
            if metric not in METRICS:
                must = f"a metric, as coopmm simulate --out writes them{closest(metric, METRICS)}"
                raise UserError(f"requirements.{metric}", must, "unknown")
        return self

    @model_validator(mode="after")
    def _what_varies_can(self) -> Scenario:
        if self.uncertainty.entries():
            from coopmm_jax.scenario.variation import vary  # imports scipy, which few scenarios need

            vary(self)
        return self


def load_scenario(name_or_path: str | Path, **overrides: Any) -> Scenario:
    """A shipped scenario by name, or a scenario file by path, with some fields changed.

    Args:
        name_or_path: a name from ``list_scenarios()``, or the path of a TOML file.
        overrides: sections, as tables of the fields to change: ``gains={"K_lambda": 2.0}``.

    Raises:
        UserError: no such scenario, a file that is not TOML, an unknown field, or a value it cannot have.

    >>> load_scenario("paper").steps
    20000
    """
    return validate(Scenario, merged(_read(_find(str(name_or_path), Path(), "scenario")), overrides))


def list_scenarios() -> dict[str, str]:
    """The shipped scenarios: name -> one line of description.

    >>> "paper" in list_scenarios()
    True
    """
    return {name: load_scenario(name).description for name in sorted(_shipped())}


def _shipped() -> dict[str, Path]:
    folder = Path(str(resources.files("coopmm_jax"))) / "scenarios"
    return {path.stem: path for path in folder.glob("*.toml")}


def _find(name_or_path: str, folder: Path, field: str) -> Path:
    """The file that a name, or a path relative to ``folder``, stands for, as ``field`` of the input gives it."""
    shipped = _shipped()
    if name_or_path in shipped:
        return shipped[name_or_path]
    path = folder / resolve_path(name_or_path, field)
    if path.suffix == ".toml" or path.is_file():
        return path
    names = ", ".join(sorted(shipped))
    raise UserError(field, f"one of {names} or a .toml file{closest(name_or_path, shipped)}", name_or_path)


def _read(path: Path) -> dict[str, Any]:
    """The tables of a scenario file, laid over those of its ``base``, and so on."""
    field, laid, seen = "scenario", [], set()
    while path is not None:
        tables = read_toml(path, field)
        if os.path.realpath(path) in seen:
            raise UserError("base", "a scenario that does not inherit from this one", path)
        seen.add(os.path.realpath(path))
        base, field = tables.pop("base", None), "base"
        if not isinstance(base, str | None):
            raise UserError("base", "the name or path of a scenario", base)
        path = None if base is None else _find(base, path.parent, "base")
        laid.append(tables)
    return functools.reduce(merged, reversed(laid), {})


def _spread(value: Any, count: int) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,) * count


def _scaled(value: Any, factor: float) -> Any:
    return tuple(factor * entry for entry in value) if isinstance(value, tuple) else factor * value


def _per_robot(kind: type, values: Mapping[str, Any]) -> tuple[Any, Any]:
    """One ``kind`` for each robot, from numbers and pairs named as its fields."""
    columns = [_spread(values[name], 2) for name in kind._fields]
    return kind(*(first for first, _ in columns)), kind(*(second for _, second in columns))


def _inertias(values: Mapping[str, Any]) -> tuple[Inertia, Inertia]:
    return _per_robot(Inertia, {**values, "m_obj": (0.0, values["m_obj"])})  # robot II carries the object
