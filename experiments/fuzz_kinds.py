"""Seeded fuzzing of kinds: references, surfaces, disturbances and whatever else scenario files choose by name.

    python -m experiments.fuzz_kinds [--cases 2000] [--seed 0] [--groups disturbance surface]

A case is a scenario in which one kind has numbers within its declared bounds, most of them plausible, some extreme.
Loading it must give a scenario or a ``UserError`` of one printable line. What loads is run for a few steps, in batches:
a rollout completes with finite metrics, or ends with a status; anything that is not finite elsewhere is a complaint.
Kinds and fields come from the registry, so those of a plugin (--plugin) are fuzzed like the built-in ones.

Exit codes: 0 all cases are as they should be, 1 some are not (one line each).
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin

import jax
import numpy as np

from coopmm_jax import runtime
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import plugins, registry
from coopmm_jax.kinds.protocol import MISSING, Field, quantity
from coopmm_jax.metrics.table import LATE, METRICS
from coopmm_jax.scenario.feasible import check_reference
from coopmm_jax.scenario.kind_sections import Chosen, choice_of, is_pair, is_scalar, is_vector
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.status import Status
from coopmm_jax.sweeps import measure

BATCH, STEPS, ENTRIES = 32, 20, 5
LONGEST = 500  # characters of a message
_EXTREME = (0.0, -0.0, 1e-300, -1e-300, 1e-9, 1e9, -1e9, 1e150, -1e150, 1e300, 1.7e308)
_ODD: tuple[Any, ...] = ("", "x", "none", [], {}, [[]], [1.0], True, float("nan"), float("inf"), 10**400, {"kind": "x"})
_PLAUSIBLE = 0.85  # of the numbers
_USUAL = 0.97  # of the whole numbers, choices and texts
_AROUND = 12  # points of a path
_MIDDLES = {"force": 15.0, "height": 1.0, "contact": 0.0}  # of a number over time, by its field [N, m]
_STEP = 1e-3  # [s]
# What a part of a reference needs beside it.
ALONG_A_PATH: dict[str, dict[str, Any]] = {
    "reference": {"path": {"kind": "ellipse"}},
    "initial": {"x": [2.4, 1.0], "th": 0.0, "a1": 1.5708, "a2": [-0.7954, 2.3462], "a3": 1.5908},
}


class Place(NamedTuple):
    """A field of the scenario that is one kind of a group, or a list of them."""

    path: tuple[str, ...]
    choice: Chosen


def places(section: Any = Scenario, path: tuple[str, ...] = ()) -> Iterator[Place]:
    """Fields of a section, and of those in it, that choose a kind."""
    for name, info in section.model_fields.items():
        choice = choice_of(info)
        if choice is not None:
            yield Place((*path, name), choice)
        elif hasattr(info.annotation, "model_fields"):
            yield from places(info.annotation, (*path, name))


class Fuzzer:
    """Makes tables of kinds; files that they name are written into a folder."""

    def __init__(self, seed: int, folder: Path):
        self.random, self.folder = random.Random(seed), folder
        self.together: dict[tuple[str, str], Callable[[float], dict[str, Any]]] = {
            ("course", "sine"): lambda middle: {"mean": middle, "amplitude": 0.1},
            ("course", "steps"): lambda middle: {"times": self._rising(), "levels": self._near(middle, ENTRIES + 1)},
            ("course", "table"): lambda middle: self._entries(middle) | {"tolerance": 1.0},
            ("disturbance", "table"): self._entries,
            ("path", "fourier"): lambda _: {
                "xc": [2.5, *self._near(0.0, ENTRIES - 1)],
                "xs": self._near(0.0, ENTRIES),
                "yc": self._near(0.0, ENTRIES),
                "ys": [2.5, *self._near(0.0, ENTRIES - 1)],
            },
            ("path", "waypoints"): lambda _: self._points(),
            ("path", "csv"): lambda _: self._file(),
        }

    def table(self, place: Place, kind: str) -> dict[str, Any]:
        """A table that chooses a kind, with numbers for most of its fields and of those that all have in common."""
        fields = registry.find(place.choice.group, kind).fields
        table: dict[str, Any] = {"kind": kind}
        for name, field in fields.items():
            if field.default is MISSING or self.random.random() < 0.8:
                table[name] = self.value(field)
        for name, info in place.choice.base.model_fields.items():
            if info.annotation is float:  # all of them, so that few programs are enough
                table[name] = self.number(Field(float, quantity(""), info.default))
        fitting = self.together.get((place.choice.group, kind))
        if fitting and self.random.random() < _PLAUSIBLE:
            table |= fitting(_MIDDLES.get(place.path[-1], 1.0))
        if self.random.random() < 0.1:
            table[self.random.choice(list(table))] = self.random.choice(_ODD)
        return table

    def value(self, field: Field) -> Any:
        """Value of a field's type; a few are odd."""
        plain = field.type
        if is_scalar(plain):
            return self.number(field)
        if is_pair(plain):
            return [self.number(field) for _ in range(2)]
        if is_vector(plain):
            numbers = [self.number(field) for _ in range(ENTRIES + (self.random.random() < 0.1))]
            return sorted(numbers) if self.random.random() < 0.7 else numbers
        if get_origin(plain) is tuple and any(get_origin(entry) is tuple for entry in get_args(plain)):
            return [[self.number(field), self.number(field)] for _ in range(self.random.choice((3, 8, 12)))]
        if plain in (bool, int, str) and field.default is not MISSING and self.random.random() < _USUAL:
            return field.default  # most programs depend on them
        if plain is int:
            return self.random.randint(0, 41)
        if plain is bool:
            return self.random.random() < 0.5
        choices = get_args(plain)
        return self.random.choice(choices) if choices and self.random.random() < 0.9 else self.random.choice(_ODD)

    def _entries(self, middle: float) -> dict[str, Any]:
        """Fields of kind table that fit together, with values about ``middle`` [N, m]."""
        return {"times": self._rising(), "values": self._near(middle, ENTRIES)}

    def _points(self) -> dict[str, Any]:
        """Fields of kind waypoints that make a path: points round a loop."""
        angles = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
        radii = 2.5 + np.array([self.random.uniform(-0.3, 0.3) for _ in angles])
        x, y = radii * np.cos(angles), radii * np.sin(angles)
        return {"x": x.tolist(), "y": y.tolist(), "tolerance": 0.1}

    def _file(self) -> dict[str, Any]:
        """Fields of kind csv that make a path, and its file."""
        points, file = self._points(), self.folder / f"points_{self.random.randrange(10**9)}.csv"
        lines = (f"{x},{y}\n" for x, y in zip(points["x"], points["y"], strict=True))
        file.write_text("".join(lines), encoding="utf-8")
        return {"file": str(file), "content": "", "tolerance": 0.1}

    def _rising(self) -> list[float]:
        """Times [s], at 0.1 s from one another at least."""
        return np.cumsum([self.random.uniform(0.1, 2.0) for _ in range(ENTRIES)]).tolist()

    def _near(self, middle: float, count: int) -> list[float]:
        """So many values [N, m] about ``middle``."""
        return [middle + self.random.uniform(-0.1, 0.1) for _ in range(count)]

    def number(self, field: Field) -> float:
        """Number about a field's default [in its unit], or an extreme one; mostly within its bounds."""
        if self.random.random() > _PLAUSIBLE:
            return self.random.choice(_EXTREME)
        default = field.default if isinstance(field.default, float | int) else 1.0
        drawn = default * self.random.uniform(0.3, 2.0) + self.random.uniform(-0.3, 0.3)
        about = field.about
        low = max((x for x in (about.above, about.at_least) if x is not None), default=-np.inf)
        high = min((x for x in (about.below, about.at_most) if x is not None), default=np.inf)
        inside = low < drawn < high
        return drawn if inside else (low + 0.1 if np.isfinite(low) else high - 0.1)


def scenario_with(place: Place, table: dict[str, Any]) -> Scenario:
    """A short scenario with a kind in its place.

    Raises:
        UserError: as ``load_scenario`` and ``check_reference``.
    """
    section, *deeper = place.path
    tables: Any = table
    for name in reversed(deeper):
        tables = {name: tables}
    base = ALONG_A_PATH if section in ("reference", "coupling") else {}
    laid = {section: base.get(section, {}) | tables} if deeper else {section: table}
    short = {"duration": STEPS * _STEP, "step": _STEP}
    scenario = load_scenario("paper", **(base | {"simulation": short} | laid))
    check_reference(scenario)
    return scenario


class Outcome(NamedTuple):
    """Endings of all cases."""

    complaints: list[str]
    ends: Counter[str]  # how many were refused, or ended with each status
    loaded: dict[str, tuple[int, int]]  # of each kind in its place, how many loaded, of how many cases


def fuzz(cases: int, seed: int, groups: tuple[str, ...] = (), rollouts: bool = True) -> Outcome:
    """Outcome of so many cases, spread over all kinds.

    Args:
        cases: how many.
        seed: of their numbers.
        groups: of the kinds; all where it is empty.
        rollouts: run what loads.
    """
    with tempfile.TemporaryDirectory() as folder:
        return _fuzz(Fuzzer(seed, Path(folder)), cases, groups, rollouts)


def _fuzz(fuzzer: Fuzzer, cases: int, groups: tuple[str, ...], rollouts: bool) -> Outcome:
    complaints, ends = [], Counter[str]()
    loaded, tried = Counter[str](), Counter[str]()
    chosen = [place for place in places() if not groups or place.choice.group in groups]
    kinds = [(place, kind) for place in chosen for kind in registry.known(place.choice.group)]
    programs: dict[Any, list[tuple[Any, Any]]] = defaultdict(list)
    for number in range(cases):
        place, kind = kinds[number % len(kinds)]
        table = fuzzer.table(place, kind)
        label = f"{'.'.join(place.path)} {kind}"
        tried[label] += 1
        name = f"case {number}: {'.'.join(place.path)} = {str(table)[:200]}"
        try:
            with warnings.catch_warnings(action="ignore"):
                scenario = scenario_with(place, table)
                parameters = scenario.parameters()
        except UserError as error:
            text = str(error)
            ends["refused"] += 1
            if not text.isprintable() or len(text) > LONGEST:
                complaints.append(f"{name}: {text!r}")
        except Exception as error:
            complaints.append(f"{name}: {type(error).__name__}: {error}")
        else:
            loaded[label] += 1
            programs[scenario.structure(), jax.tree.structure(parameters)].append((name, parameters))
    for (structure, _), waiting in programs.items() if rollouts else ():
        complaints += _run(structure, waiting, ends)
    return Outcome(complaints, ends, {label: (loaded[label], count) for label, count in tried.items()})


def _run(structure: Any, waiting: list[tuple[str, Any]], ends: Counter[str]) -> Iterator[str]:
    """Complaints about the rollouts of one program."""
    horizon, device = measure.Horizon(_STEP, STEPS, "float64"), jax.devices()[0]
    expected = [name for name, metric in METRICS.items() if metric.reduction != "time_if_complete"]
    columns = [list(METRICS).index(name) for name in expected if METRICS[name].window != LATE]
    for start in range(0, len(waiting), BATCH):
        batch = waiting[start : start + BATCH]
        full = [parameters for _, parameters in (batch * BATCH)[:BATCH]]
        stacked = jax.tree.map(lambda *leaves: np.array(leaves, dtype=float), *full)
        found = measure.measure(structure, horizon, device, stacked)
        for (name, _), metrics, status, time in zip(batch, *found, strict=False):
            ended = status in {code.value for code in Status}
            if not ended or (status == Status.OK) != np.isnan(time):
                yield f"{name}: status {status} at {time}"
            ends[Status(status).name] += 1
            started = status == Status.OK or time > 0.0
            if started and not np.all(np.isfinite(metrics[columns])):
                wrong = [list(METRICS)[i] for i in columns if not np.isfinite(metrics[i])]
                yield f"{name}: {Status(status).name}, and not finite: {', '.join(wrong)}"


def main() -> int:
    """Fuzz and print what is wrong; the exit code."""
    parser = argparse.ArgumentParser(description="Fuzz kinds.")
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--groups", nargs="*", default=[])
    parser.add_argument("--plugin", action="append", default=[])
    options = parser.parse_args()
    runtime.use_fast_compilation(batches=not runtime.backend_is_up())
    runtime.use_compilation_cache()
    for plugin in options.plugin:
        plugins.load_plugin(plugin)
    complaints, ends, loaded = fuzz(options.cases, options.seed, tuple(options.groups))
    print("\n".join(complaints))
    for label, (count, tried) in loaded.items():
        print(f"{label:32} {count:4} of {tried:4} load")
    print(", ".join(f"{count} {name}" for name, count in ends.most_common()))
    print(f"{len(complaints)} of {options.cases} cases are not as they should be")
    return int(bool(complaints))


if __name__ == "__main__":
    sys.exit(main())
