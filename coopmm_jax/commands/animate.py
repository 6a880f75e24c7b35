"""``coopmm animate``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import coopmm_jax
from coopmm_jax.commands import DONE, ROLLOUT_FAILED
from coopmm_jax.commands.fields import OVERRIDES
from coopmm_jax.commands.options import add_gains_file, add_overwrite, check_out, with_gains
from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path, result_folder
from coopmm_jax.runs.store import read_run
from coopmm_jax.scenario.scenario import Scenario, load_scenario, shipped

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers
    from coopmm_jax.runs.trajectory import Trajectory


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "animate",
        help="show a run, or two side by side, as a GIF, a web page or a film",
        usage=f"coopmm animate (SCENARIO | DIR) --out FILE [--against (SCENARIO | DIR)] {OVERRIDES} [options]",
        epilog="Overrides change SCENARIO; those of [simulation] also the scenario of --against. "
        "coopmm simulate --help lists them.",
        allow_abbrev=False,
    )
    parser.add_argument("shown", metavar="SCENARIO|DIR", help="a scenario, or a folder of coopmm simulate --out")
    parser.add_argument("--out", metavar="FILE", required=True, help="a .gif, .html or .mp4 (needs ffmpeg) file")
    parser.add_argument("--against", metavar="SCENARIO|DIR", help="another run, to show beside it")
    add_overwrite(parser)
    add_gains_file(parser, "gains for SCENARIO: a TOML file, or a folder of coopmm tune or simulate")
    parser.add_argument("--fps", type=float, default=25.0, help="frames per second (%(default)g)")
    parser.add_argument("--speed", type=float, default=1.0, help="simulated seconds per second (%(default)g)")
    parser.add_argument("--width", type=int, default=800, help="of the picture, in pixels (%(default)d)")
    parser.set_defaults(run=run, parser=parser, takes_overrides=True, computes=True)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Simulate or load the runs, and write the animation.

    Raises:
        UserError: overrides that change nothing, or as ``animate``, ``load_scenario`` and ``read_run``.
    """
    from coopmm_jax.animation import film  # imports matplotlib, as does the next
    from coopmm_jax.plotting.style import plain

    path = resolve_path(options.out, "--out")
    write, look = film.writer(path), {"fps": options.fps, "speed": options.speed, "width": options.width}
    film.check_look(**look, count=1 if options.against is None else 2)
    shown = _shown(options, changes)
    check_out(options, path, file=True)
    film.frame_count(max(map(_duration, shown.values())), **look)
    with result_folder(path.parent) as folder:
        runs = {label: _trajectory(source) for label, source in shown.items()}
        frames = film.Animation(*runs.values(), labels=list(map(plain, runs)) if len(runs) > 1 else None, **look)
        write(frames, folder / path.name)
    print(f"written to {path}: {len(frames)} frames")
    return _outcome(runs)


def _shown(options: argparse.Namespace, changes: dict[str, Any]) -> dict[str, Scenario | Path]:
    """Runs to show, by their names in the picture: scenarios to simulate, folders to read."""
    common = {name: value for name, value in changes.items() if name.startswith("simulation.")}
    own = {name: value for name, value in changes.items() if name not in common}
    folder = _folder(options.shown)
    gains = {} if options.gains_file is None else {"gains": _name(options.gains_file)}
    if folder is not None and gains:
        raise UserError("--gains-file", "given with a scenario to simulate", f"given with {folder}")
    second: dict[str, Scenario | Path] = {}
    if options.against is not None:
        second[_name(options.against)] = _folder(options.against) or load_scenario(options.against, **common)
    unused = own if any(isinstance(source, Scenario) for source in second.values()) else changes
    if folder is not None and unused:
        raise UserError(f"--{next(iter(unused))}", "given with a scenario to simulate", f"given with {folder}")
    label = ", ".join([_name(options.shown), *(f"{name} {value}" for name, value in (gains | own).items())])
    first = {label: folder or load_scenario(options.shown, **with_gains(options, changes))}
    return first | {name if name != label else f"{name} (--against)": source for name, source in second.items()}


def _folder(name: str) -> Path | None:
    """Folder of results of that name, unless it is a scenario; a shipped scenario goes before a folder."""
    if name in shipped():
        return None
    path = resolve_path(name, "SCENARIO|DIR")
    return path if path.is_dir() else None


def _name(shown: str) -> str:
    return Path(shown).name.removesuffix(".toml")


def _duration(source: Scenario | Path) -> float:
    """Simulated time [s] of a scenario; that of a folder shows when it is read."""
    return source.simulation.duration if isinstance(source, Scenario) else 0.0


def _trajectory(source: Scenario | Path) -> Trajectory:
    return read_run(source) if isinstance(source, Path) else coopmm_jax.simulate(source)


def _outcome(runs: dict[str, Trajectory]) -> int:
    failed = {label: run for label, run in runs.items() if not run.ok}
    for label, run in failed.items():
        ending = f"{run.status.name} at t = {run.status_time:g} s: {run.status.message}"
        print(f"coopmm: rollout {label} failed: {ending}", file=sys.stderr)
    return ROLLOUT_FAILED if failed else DONE
