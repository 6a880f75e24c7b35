"""Result of a simulation: numpy arrays with their dimensions and units, the outcome, the metrics."""

from __future__ import annotations

import dataclasses
import html
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from coopmm_jax.control.adaptive import Regressors
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import DEFAULT, controller, signals_of
from coopmm_jax.kinds.software import versions
from coopmm_jax.mechanics import partitioning
from coopmm_jax.mechanics.robot import JOINTS, PLATFORM
from coopmm_jax.metrics.table import METRICS, as_text, shown
from coopmm_jax.parameters import Rail
from coopmm_jax.status import Status

if TYPE_CHECKING:
    import xarray

    from coopmm_jax.scenario.scenario import Scenario

_LABELS: dict[str, tuple[str, ...]] = {
    "robot": ("I", "II"),
    "chained": ("z1", "z2", "z3"),
    "bound": Regressors._fields,
    "axis": ("x", "y", "z"),
    "arm_axis": ("along", "across"),
}


def _of_joints(joints: int) -> dict[str, tuple[str, ...]]:
    """Labels of the dimensions whose length is that of the arms, of robots with so many velocities u."""
    numbers = range(1, joints - PLATFORM + 1)
    return {
        "coordinate": ("x", "y", "th", *(f"a{i}" for i in numbers)),
        "rate": ("u1", "u2", *(f"a{i}_rate" for i in numbers)),
        "actuator": ("right_wheel", "left_wheel", *(f"joint_{i}" for i in numbers)),
    }


# Dimensions whose length is the run's own, and the letters that stand for it.
_SYMBOLS = {"t": "T", "row": "m", "independent": "n", "independent_arm": "na", "rail": "r", "steered": "s"}


def _array(dims: str, units: str, meaning: str) -> dict[str, Any]:
    """Description of an array: names of its dimensions, units, meaning."""
    return {"dims": tuple(dims.split()), "units": units, "meaning": meaning}


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """One simulated run at its T recorded samples.

    After a failure the arrays end with the last sample before it: everything here is finite, always. Index 0 of a robot
    dimension is robot I; m is the number of constraint rows (contact normal first), n = 10 - m that of independent
    velocities, na = n - 4 that of independent arm joints, r = 1 on a rail and else 0,
    s the number of platforms on two axles. Arms of [arm] have as many joints as it says, a lift before the links; where
    the robots' differ, what one has not is zero.
    """

    t: np.ndarray = field(metadata=_array("t", "s", "time"))
    q: np.ndarray = field(
        metadata=_array("t robot coordinate", "m, m, rad, rad, rad, rad", "world coordinates (x, y, th, a1, a2, a3)")
    )
    zeta: np.ndarray = field(metadata=_array("t robot chained", "rad, m, m", "chained coordinates (z1, z2, z3) of (6)"))
    zeta_desired: np.ndarray = field(metadata=_array("t robot chained", "rad, m, m", "desired chained coordinates"))
    arm: np.ndarray = field(metadata=_array("t robot", "rad", "arm yaw a1"))
    arm_desired: np.ndarray = field(metadata=_array("t robot", "rad", "desired arm yaw"))
    velocity: np.ndarray = field(
        metadata=_array("t robot rate", "rad/s, m/s, rad/s, rad/s, rad/s", "u1, u2 of (8), joint rates")
    )
    controller: dict[str, np.ndarray]  # its own signals by name, which can be read as attributes of the run too
    constraint_force: np.ndarray = field(
        metadata=_array("t row", "N", "constraint forces lambda; the contact presses if positive")
    )
    constraint_force_desired: np.ndarray = field(metadata=_array("t row", "N", "desired constraint forces"))
    torque: np.ndarray = field(metadata=_array("t robot actuator", "N m", "actuator torques tau"))
    torque_commanded: np.ndarray = field(
        metadata=_array("t robot actuator", "N m", "the same before the actuators' limits and lag")
    )
    constraint_residual: np.ndarray = field(metadata=_array("t row", "m", "constraint residuals phi"))
    tip: np.ndarray = field(metadata=_array("t robot axis", "m", "tips in the world; that of robot II is the object"))
    contact_point: np.ndarray = field(
        metadata=_array(
            "t arm_axis", "m", "tip I from the arc's centre, else from the object, along arm II and across it"
        )
    )
    carriage: np.ndarray = field(
        metadata=_array("t rail", "-", "carriage of the object's rail, a phase of its path; of no rail, none")
    )
    steering: np.ndarray = field(
        metadata=_array("t steered", "rad", "angle of each front axle, of platforms on two axles; of others none")
    )
    status: Status
    status_time: float | None  # [s] of the failure
    metrics: dict[
        str, float
    ]  # as ``metrics.METRICS`` describes, over all samples, recorded or not; robustness of sentences
    scenario: Scenario

    @property
    def ok(self) -> bool:
        """True if the run reached its horizon."""
        return self.status is Status.OK

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the constraint rows (m,)."""
        return self.scenario.coupling.rows

    @property
    def law(self) -> Any:
        """Class of the controller."""
        return _controller(self.scenario)

    def entries_of(self, name: str) -> list[str]:
        """Labels of the entries of an array (T, n)."""
        return self._labels()[self.arrays[name]["dims"][1]]

    @property
    def arrays(self) -> dict[str, dict[str, Any]]:
        """Dimensions, units and meaning of every array of this run, by name."""
        return arrays_of(self.scenario)

    def check(self) -> None:
        """Check that all arrays have the shapes that their dimensions say, and finite numbers.

        Raises:
            ValueError: the first that has not.
        """
        sizes = {"t": len(self.t)} | {dim: len(labels) for dim, labels in self._labels().items()}
        for name, about in self.arrays.items():
            value = getattr(self, name)
            if value.shape != tuple(sizes[dim] for dim in about["dims"]) or value.dtype.kind != "f":
                raise ValueError(f"{name} is {value.dtype} of shape {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} has numbers that are not finite")

    def to_xarray(self) -> xarray.Dataset:
        """All arrays by name, with labelled dimensions and units; the rest in the data set's attributes.

        Attributes are texts or numbers, metrics and versions as JSON, so that ``to_netcdf`` takes them.

        >>> import coopmm_jax as cm
        >>> data = cm.simulate(cm.load_scenario("paper", simulation={"duration": 0.01})).to_xarray()
        >>> data.torque.sel(robot="I", actuator="joint_1").dims
        ('t',)
        """
        from coopmm_jax.runs.dataset import Labelled  # imports xarray

        arrays = self.arrays.items()
        variables = {name: (about["dims"], getattr(self, name), _attributes(about)) for name, about in arrays}
        attributes = {
            "status": self.status.name,
            "status_message": self.status.message,
            "status_time": math.nan if self.status_time is None else self.status_time,
            "metrics": json.dumps(dict(self.metrics)),
            "scenario": self.scenario.to_toml(),
            "versions": json.dumps(versions()),
        }
        return Labelled(variables, coords=self._labels(), attrs=attributes)

    def _labels(self) -> dict[str, list[str]]:
        joints = self.scenario.structure().joints
        of_joints, part = _of_joints(max(joints)), partitioning.partition(self.rows, joints)
        independent = [
            (joint, f"{robot}_{of_joints['rate'][joint]}")
            for robot, own in zip(_LABELS["robot"], part.independent, strict=True)
            for joint in own
        ]
        return {
            **{dim: list(labels) for dim, labels in (_LABELS | of_joints).items()},
            "row": list(self.rows),
            "rail": ["carriage"] if self._on_a_rail() else [],
            "steered": self._steered(),
            "independent": [label for _, label in independent],
            "independent_arm": [label for joint, label in independent if joint >= PLATFORM],
            **_own_labels(self.law),
        }

    def _steered(self) -> list[str]:
        """Names of the robots whose platforms have two axles."""
        pairs = zip(_LABELS["robot"], self.scenario.parameters().plant.geometry, strict=True)
        return [robot for robot, geometry in pairs if geometry.front is not None]

    def _on_a_rail(self) -> bool:
        return "guide_radial" in self.rows and isinstance(self.scenario.parameters().plant.guide, Rail)

    def __getattr__(self, name: str) -> np.ndarray:
        """A signal of the controller: ``run.sigma`` is ``run.controller["sigma"]``."""
        signals = self.__dict__.get("controller", {})
        if name not in signals:
            raise AttributeError(name)
        return signals[name]

    def __repr__(self) -> str:
        end = f"{self.t[-1]:g} s" if len(self.t) else "0 s"
        outcome = "OK" if self.ok else f"{self.status.name} at {self.status_time:g} s"
        return f"<Trajectory: {len(self.t)} samples to {end}, {self.t.dtype}, {outcome}>"

    def _repr_html_(self) -> str:
        """Table for a notebook: the outcome, and the metrics that tell a good run from a bad one."""
        rows = "".join(
            f"<tr><td>{name}</td><td>{as_text(self.metrics[name], '.4g')}</td><td>{METRICS[name].unit}</td>"
            f"<td style='text-align: left'>{html.escape(METRICS[name].meaning)}</td></tr>"
            for name in shown()
        )
        ending = "" if self.ok else f"<br>{html.escape(self.status.message)}"
        head = f"<b>{html.escape(repr(self)[1:-1])}</b>{ending}<br>{html.escape(self.scenario.description)}"
        return f"<div>{head}<table>{rows}</table></div>"


# The fields that are arrays: name -> dims, units, meaning.
ARRAYS = {entry.name: entry.metadata for entry in dataclasses.fields(Trajectory) if "dims" in entry.metadata}


def arrays_of(scenario: Scenario) -> dict[str, dict[str, Any]]:
    """Dimensions, units and meaning of every array of a scenario's runs, those of its controller among them.

    Raises:
        UserError: the controller has a signal of the name of an array that all runs have.
    """
    made = _controller(scenario)
    found: dict[str, Any] = dict(ARRAYS)
    for name, about in _of_signals(made).items():
        if name in Trajectory.__dataclass_fields__:
            raise UserError(f'controller "{scenario.law.controller}": signals', "named unlike what every run has", name)
        found[name] = about
    return found


def _controller(scenario: Scenario) -> Any:
    return controller(scenario.law.controller).made


def _of_signals(made: Any) -> dict[str, dict[str, Any]]:
    found = {}
    for name, signal in signals_of(made).items():
        own = f"{name}_entry" if isinstance(signal.per, tuple) else signal.per
        found[name] = _array("t" if own is None else f"t {own}", signal.unit, signal.meaning)
    return found


def _own_labels(made: Any) -> dict[str, list[str]]:
    """Labels of the dimensions of signals whose entries have names of their own."""
    signals = signals_of(made).items()
    return {f"{name}_entry": list(signal.per) for name, signal in signals if isinstance(signal.per, tuple)}


def _attributes(about: Mapping[str, Any]) -> dict[str, str]:
    return {"units": about["units"], "long_name": about["meaning"]}


def _described(name: str, about: Mapping[str, Any]) -> str:
    sizes = [_SYMBOLS.get(dim) or str(len((_LABELS | _of_joints(JOINTS))[dim])) for dim in about["dims"]]
    return f"        {name} ({', '.join(sizes)}) [{about['units']}]: {about['meaning']}\n"


_listed = "".join(_described(name, about) for name, about in ARRAYS.items())
_signals = "".join(_described(name, about) for name, about in _of_signals(controller(DEFAULT).made).items())
Trajectory.__doc__ = f"{Trajectory.__doc__}\n    Arrays:\n{_listed}\n    Signals of {DEFAULT}:\n{_signals}"
