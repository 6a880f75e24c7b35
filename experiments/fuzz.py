"""Seeded fuzzing of the command line: scenario files, gains files, options, uncertainty, stores, runs and states.

    python -m experiments.fuzz [--cases 2000] [--seed 0]

A case is a command with something wrong, or odd, in one of its inputs. It must end with exit code 0, 2 or 3; a refusal
is one printable line of at most 500 characters; no exception and no warning gets out. Nothing is computed: where a
rollout would begin, the case has passed.

Exit codes: 0 all cases are as they should be, 1 some are not (one line each).
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import random
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import tomli_w

import coopmm_jax as cm
from coopmm_jax import cli
from coopmm_jax.animation import film
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.plotting import style
from coopmm_jax.runs import simulation
from coopmm_jax.runs.store import write_run
from coopmm_jax.scenario.gains_file import gains_text
from coopmm_jax.scenario.places import names
from coopmm_jax.scenario.scenario import Scenario, list_scenarios, load_scenario
from coopmm_jax.status import Status
from coopmm_jax.sweeps import measure
from coopmm_jax.sweeps.measure import Measured
from tuning.cost import evaluate
from tuning.studies import state, tune

_SWEPT = "--out s.zarr --batch 8 --keep 8 --samples 24"
LONGEST = 500  # characters of a message
VARIED = {"disturbance.phase": {"distribution": "uniform", "low": 0.0, "high": 6.0}}
_NAMES = [name for name in names(Scenario()) if "." in name]
_ODD: list[Any] = [
    0, -1, 1, 2, 3, 0.5, -0.0, 1e-300, 1e308, -1e308, 1e-310, 2**31, 2**63, 2**64, 10**400, float("inf"), float("nan"),
    True, False, "", "x", "none", "scenario", "full", "uniform", "<= 1", ">= nan", "paper", "\x1b[31m", "λ", "a b", "~",
    "x" * 2000, [], {}, [[]], [1], [1, 2], [1.0, 2.0, 3.0], [1, "a"], [{}], {"x": 1}, {"1": 1, "2": 2}, {"low": 1},
    {"distribution": "uniform", "low": 0.5, "high": 1.5}, {"distribution": "normal", "mean": 1e308, "std": 1e308},
    {"distribution": "log_uniform", "low": 1e-300, "high": 1e300, "relative": True}, {"distribution": "none"},
]  # fmt: skip
_WORDS = [
    ".5",
    "5.",
    "1e400",
    "0x" + "f" * 5000,
    "9" * 5000,
    "[" * 3000,
    "--",
    "-",
    "=",
    "{",
    "'",
    '"',
    "#",
    "1 2",
    "\\",
]
_BYTES = [b"", b"\0", b"\xff\xfe", b"null", b"{}", b"[]", b"[[]]", b"PK\x03\x04", b"\x93NUMPY", b"=", b"\xef\xbb\xbf"]


class Computes(BaseException):
    """A rollout would begin."""


class Case:
    """One command and how to put its inputs back."""

    def __init__(self, words: list[str], undo: Callable[[], None] = lambda: None):
        self.words, self.undo = words, undo


class Fuzzer:
    """Makes cases in a folder of its own."""

    def __init__(self, seed: int, folder: Path):
        self.random, self.folder = random.Random(seed), folder
        self.shipped = tuple(list_scenarios())
        self.scenarios = [load_scenario(name).model_dump(exclude_none=True) for name in self.shipped]
        self.gains = load_scenario("paper").gains
        self.kinds = [self.scenario_file, self.options, self.gains_file, self.uncertainty_file, self.damage]
        _prepare(folder)

    def case(self) -> Case:
        """The next case."""
        return self.random.choice(self.kinds)()

    def scenario_file(self) -> Case:
        """A scenario whose tables, or text, are not quite right."""
        tables = self._mutated(self.random.choice(self.scenarios))
        if self.random.random() < 0.2:
            tables["base"] = self.random.choice([*self.shipped, "s.toml", "none.toml", ".", 3, "\0"])
        name = self._write(tables)
        command = self.random.choice(["simulate {}", "sweep {} --out new.zarr", "tune {} --out new", "falsify {}"])
        return Case(command.format(name).split())

    def options(self) -> Case:
        """A command with odd overrides and options."""
        commands = {
            "simulate paper": ["--sample", "--from", "--gains-file", "--precision"],
            "sweep v.toml --out new.zarr": [
                "--samples",
                "--seed",
                "--sampling",
                "--keep",
                "--batch",
                "--rank",
                "--size",
            ],
            "report s.zarr": ["--out", "--requirements.force-min"],
            "animate run --out x.gif": ["--fps", "--speed", "--width", "--against", "--out"],
            "tune v.toml --out new": ["--seed", "--pareto", "--gains-file", "--resume", "--adversarial"],
            "compare scenario g.toml --scenario v.toml": ["--samples", "--seed"],
            "falsify v.toml": ["--rollouts", "--starts", "--compare-random", "--out", "--seed"],
            "scenarios": ["--version2"],
        }
        command = self.random.choice(list(commands))
        words = command.split()
        for _ in range(self.random.randint(1, 3)):
            own = self.random.random() < 0.4
            name = self.random.choice(commands[command]) if own else f"--{self._slip(self.random.choice(_NAMES))}"
            value = self._text()
            words += self.random.choice([[name, value], [f"{name}={value}"], [name], [name, value, self._text()]])
        return Case(words)

    def gains_file(self) -> Case:
        """A file of gains that is not quite right."""
        name = self._write(self._mutated({"gains": dict(self.gains), "law": {"delta_floor": 0.1}}))
        return Case(self.random.choice(["simulate paper --gains-file {}", "compare scenario {} --scenario v.toml"])
                    .format(name).split())  # fmt: skip

    def uncertainty_file(self) -> Case:
        """A file of uncertainty and requirements that is not quite right."""
        law = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
        entries = {self._slip(self.random.choice(_NAMES)): dict(law) for _ in range(self.random.randint(1, 3))}
        tables = self._mutated({"uncertainty": entries, "requirements": {"force_min": ">= 0"}})
        return Case(["sweep", "paper", "--uncertainty", self._write(tables), "--out", "new.zarr"])

    def damage(self) -> Case:
        """A store, a run or a tuning's state with one file that is not what it was."""
        folder, commands = self.random.choice(
            [
                (
                    "s.zarr",
                    ["report s.zarr", "simulate --from s.zarr --sample 3", f"sweep v.toml --resume {_SWEPT}"],
                ),
                ("run", ["animate run --out x.gif"]),
                ("tuned", ["tune v.toml --resume --out tuned"]),
            ]
        )
        path = self.random.choice(sorted(p for p in (self.folder / folder).rglob("*") if p.is_file()))
        content = path.read_bytes()

        def undo() -> None:
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
            path.write_bytes(content)

        path.unlink()
        how = self.random.randrange(5)
        if how == 1:
            path.mkdir()
        elif how > 1:
            path.write_bytes(self._spoilt(content))
        return Case(self.random.choice(commands).split(), undo)

    def _mutated(self, tables: dict[str, Any]) -> dict[str, Any]:
        result = {name: dict(value) if isinstance(value, dict) else value for name, value in tables.items()}
        for _ in range(self.random.randint(1, 4)):
            section = self.random.choice(list(result))
            table = result[section]
            where, keys = (table, list(table)) if isinstance(table, dict) and table else (result, [section])
            key, how = self.random.choice(keys), self.random.random()
            if how < 0.5:
                where[key] = self._odd()
            elif how < 0.6:
                del where[key]
            elif how < 0.8:
                where[self._slip(key)] = self._odd()
            else:
                result[self.random.choice(["one", "list", "base", "gain", "", "a.b"])] = self._odd()
            if not result:
                break
        return result

    def _write(self, tables: dict[str, Any]) -> str:
        """Name of a new file of the tables, or of something like their text."""
        text = tomli_w.dumps(tables).encode("utf-8", "replace")
        (self.folder / "s.toml").write_bytes(self._spoilt(text) if self.random.random() < 0.3 else text)
        return "s.toml"

    def _spoilt(self, content: bytes) -> bytes:
        at, how = self.random.randrange(len(content) + 1), self.random.random()
        if how < 0.3:
            return self.random.choice(_BYTES)
        if how < 0.6:
            return content[:at]
        piece = self.random.choice([*_BYTES, self.random.randbytes(3)])
        return content[:at] + piece + content[at + self.random.randrange(4) :]

    def _slip(self, name: str) -> str:
        """A name, perhaps with a slip of the pen."""
        at, how = self.random.randrange(len(name) + 1), self.random.random()
        return name if how < 0.6 else name[:at] + self.random.choice(["", ".", "-", "x", "λ"]) + name[at + 1 :]

    def _odd(self) -> Any:
        return copy.deepcopy(self.random.choice(_ODD))

    def _text(self) -> str:
        if self.random.random() < 0.3:
            return self.random.choice(_WORDS)
        value = self._odd()
        try:
            return tomli_w.dumps({"x": value}).partition("= ")[2].strip() or str(value)
        except (TypeError, ValueError):
            return str(value)[:400]


def _prepare(folder: Path) -> None:
    """A small store, a run, a tuning's state and a gains file to begin with."""
    short = load_scenario("paper", simulation={"duration": 0.05}, uncertainty=VARIED)
    (folder / "v.toml").write_text(short.to_toml(), encoding="utf-8")
    with mock.patch.multiple(measure, measure=_measured, trace=_traced):
        cm.sweep(short, samples=24, batch=8, keep=8, out=folder / "s.zarr")
    run = cm.simulate(load_scenario("paper", simulation={"duration": 0.02}))
    (folder / "run").mkdir()
    write_run(folder / "run", run.scenario, run)
    (folder / "tuned").mkdir()
    state.write(folder / "tuned", {"best": np.zeros(3)}, short.to_toml())
    (folder / "g.toml").write_text(gains_text(load_scenario("paper").parameters().gains), encoding="utf-8")


def _measured(*_: Any) -> Measured:
    noise = np.random.default_rng(0)
    return Measured(noise.normal(size=(8, len(METRICS))), np.full(8, Status.OK, np.int8), np.full(8, np.nan))


def _traced(_: Any, horizon: measure.Horizon, *__: Any) -> dict[str, np.ndarray]:
    return {name: np.ones((8, len(horizon.points()))) for name in measure.SERIES}


def _computes(*_: Any, **__: Any) -> None:
    raise Computes


@contextlib.contextmanager
def nothing_computed() -> Iterator[None]:
    """Commands end where rollouts and figures would begin."""
    parser = cli._parser([])  # takes longer to make than most cases
    with contextlib.ExitStack() as stack:
        for place, name in ((simulation, "_compiled"), (measure, "_run"), (evaluate, "run"), (film, "Animation")):
            stack.enter_context(mock.patch.object(place, name, _computes))
        silent = ((tune, "compile_ahead", None), (style, "publish", None), (cli, "_parser", parser))
        for place, name, found in silent:
            stack.enter_context(mock.patch.object(place, name, return_value=found))
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("error")
        yield


def complaint(words: list[str]) -> str | None:
    """Complaint about how a command ends, if there is one."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = cli.main(words)
    except Computes:
        return None
    except SystemExit as ended:
        code = int(ended.code or 0)
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    said = err.getvalue()
    if code not in (0, 2, 3):
        return f"exit code {code}"
    if code == 2 and not (said.startswith("coopmm: error: ") and said.count("\n") == 1 and said[:-1].isprintable()):
        return f"not one line: {said}"
    return f"{len(said)} characters: {said}" if len(said) > LONGEST else None


def fuzz(cases: int, seed: int) -> list[str]:
    """Complaints about so many cases, with the commands."""
    complaints = []
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        fuzzer = Fuzzer(seed, Path(name))
        with nothing_computed():
            for number in range(cases):
                case = fuzzer.case()
                found = complaint(case.words)
                case.undo()
                if found:
                    complaints.append(f"case {number}: {' '.join(case.words)[:300]!r}: {found[:300]!r}")
                for new in ("new.zarr", "new.zarr-report", "new-report", "new", "s-report"):
                    shutil.rmtree(new, ignore_errors=True)
    return complaints


def main() -> int:
    """Fuzz and print what is wrong; the exit code."""
    parser = argparse.ArgumentParser(description="Fuzz the command line.")
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    complaints = fuzz(options.cases, options.seed)
    print("\n".join([*complaints, f"{len(complaints)} of {options.cases} cases are not as they should be"]))
    return int(bool(complaints))


if __name__ == "__main__":
    sys.exit(main())
