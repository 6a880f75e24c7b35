"""``coopmm watch``: a running sweep or tuning, told from the files that it writes."""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from coopmm_jax.commands import DONE
from coopmm_jax.errors import UserError
from coopmm_jax.files import LOCK, read_npz, resolve_path
from coopmm_jax.page import REPORT
from coopmm_jax.scenario.gains_file import GAINS_FILE
from coopmm_jax.scenario.overrides import read_toml
from coopmm_jax.scenario.sections.tuning import minimised

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers

HISTORY, STATE, SETTINGS = "history.csv", "state.npz", "scenario.toml"  # of a tuning
_CLEAR = "\x1b[H\x1b[J"
_WIDTH, _HEIGHT = 60, 8  # of the cost's curve, in characters


class View(NamedTuple):
    """State of what is watched, for a reader."""

    lines: list[str]
    ended: bool


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "watch",
        help="show how far a sweep or tuning in another terminal has come",
        epilog="It reads files alone, so it disturbs nothing; it ends when there is nothing more to come.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", metavar="DIR", help="the folder of a tuning, or the store of a sweep")
    parser.add_argument("--every", metavar="SECONDS", type=float, default=2.0, help="between looks (%(default)g)")
    parser.add_argument("--once", action="store_true", help="look once")
    parser.set_defaults(run=run, parser=parser, takes_overrides=False, computes=False)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Show the state, and again where it has changed, until the end.

    Raises:
        UserError: nothing to watch, or a time that is none.
    """
    if not (math.isfinite(options.every) and options.every > 0.0):
        raise UserError("--every", "a time above 0 s", options.every)
    folder = resolve_path(options.folder, "DIR")
    before: list[str] = []
    while True:
        lines, ended = view(folder)
        if lines != before:
            print(*([_CLEAR] if sys.stdout.isatty() and not options.once else []), "\n".join(lines), sep="", flush=True)
        if ended or options.once:
            return DONE
        before = lines
        time.sleep(options.every)


def view(folder: Path) -> View:
    """State of a tuning, of several controllers' tunings in folders of their own, or of a sweep.

    Raises:
        UserError: the folder has none of them.
    """
    if (folder / HISTORY).exists():
        return _tuning(folder)
    inner = sorted(path.parent for path in folder.glob(f"*/{HISTORY}"))
    if inner:
        views = [_tuning(path) for path in inner]
        begins_another = (folder / LOCK).exists()
        ended = all(each.ended for each in views) and not begins_another
        return View([line for each in views for line in (*each.lines, "")], ended)
    if (folder / LOCK).exists():
        return View([f"{folder}: compiling and screening; the first cost comes when all starts are measured"], False)
    if (folder / REPORT).exists():  # of a front, whose tunings write no histories
        return View([f"{folder}: ended, see {REPORT}"], True)
    from coopmm_jax.sweeps.store import computed  # imports zarr

    done, total = computed(folder)
    return View([f"{folder}: {done} of {total} samples ({done / total:.0%})"], done == total)


def curve(over: Sequence[float], values: Sequence[float]) -> list[str]:
    """Curve of positive values (n,) over rising numbers (n,), logarithmic, in characters.

    >>> curve([0, 1, 2], [10.0, 1.0, 0.1])[0].rstrip()
    '        10 *'
    """
    logs = [math.log10(value) for value in values]
    low, high, first, span = min(logs), max(logs), over[0], (over[-1] - over[0]) or 1.0
    grid = [[" "] * _WIDTH for _ in range(_HEIGHT)]
    for x, y in zip(over, logs, strict=True):
        column = round((x - first) / span * (_WIDTH - 1))
        row = round((high - y) / (high - low) * (_HEIGHT - 1)) if high > low else 0
        grid[row][column] = "*"
    ends = {0: f"{10**high:10.3g} ", _HEIGHT - 1: f"{10**low:10.3g} "}
    return [ends.get(i, " " * 11) + "".join(row) for i, row in enumerate(grid)]


def _tuning(folder: Path) -> View:
    rows = _history(folder / HISTORY)
    settings = read_toml(folder / SETTINGS, "DIR").get("tuning", {})
    budget, word = float(settings.get("budget", math.nan)), minimised(settings.get("goals", "cost"))
    last, ended = rows[-1], (folder / GAINS_FILE).exists()
    done = f"{float(last['steps']) / 1e6:.3g} of {budget:.3g} M steps, {float(last['seconds']):.0f} s"
    lines = [f"{folder}: {'ended after' if ended else 'in'} {last['stage']} {last['iteration']}; {done}", ""]
    steps, best = ([float(row[name]) for row in rows] for name in ("steps", "best"))
    lines += [f"lowest {word} so far {best[-1]:.4g}", *curve(steps, best), "", *_gains(folder / STATE)]
    return View(lines, ended)


def _history(path: Path) -> list[dict[str, str]]:
    """Whole lines of the history: the last may be in the making.

    Raises:
        UserError: there are none, or they cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
        rows = list(csv.DictReader(text[: text.rfind("\n") + 1].splitlines()))
        numbers = [float(row[name]) for row in rows for name in ("steps", "best", "seconds")]
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise UserError("DIR", f"a folder with a {HISTORY} that can be read", f"{path} ({error})") from None
    if not numbers or not all(float(row["best"]) > 0.0 for row in rows):
        raise UserError("DIR", f"a folder with a {HISTORY} of positive costs", path)
    return rows


def _gains(path: Path) -> list[str]:
    """The best gains so far; nothing before the first state is written."""
    try:
        state = read_npz(path)
        pairs = zip(state["labels"].tolist(), state["gains"].tolist(), strict=True)
        return [f"{label:24} {value:12.5g}" for label, value in pairs]
    except (KeyError, TypeError, ValueError):
        return []
