"""The command ``coopmm``: simulate scenarios from the shell.

Exit codes: 0 done, 2 the input cannot be used (one line on stderr), 3 a rollout failed (status, time, quantity).

>>> main(["scenarios"])  # doctest: +ELLIPSIS
free ...
0
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any, Literal, NoReturn, get_args, get_origin

import coopmm_jax
from coopmm_jax import overrides, runtime
from coopmm_jax.errors import UserError
from coopmm_jax.metric_table import METRICS
from coopmm_jax.scenario import Scenario, list_scenarios, load_scenario
from coopmm_jax.store import result_folder, write_run
from coopmm_jax.validation import closest

DONE, BAD_INPUT, ROLLOUT_FAILED, INTERRUPTED = 0, 2, 3, 130

SHOWN = (  # the metrics that tell at a glance whether a run is any good; summary.json has them all
    *("error_late", "settling_time", "force_error_rms_late", "force_min", "force_max", "contact_loss_time"),
    *("internal_force_max", "torque_peak", "wheel_torque_variation_late", "constraint_residual_max"),
)


class UsageError(Exception):
    """A command line that argparse cannot read."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: the arguments; without them those of the process, which is then taken to run nothing else, so that XLA's
            options for fast compilation and the compilation cache are switched on.

    Returns:
        The exit code.
    """
    try:
        return _run(sys.argv[1:] if argv is None else argv, own_process=argv is None)
    except (UserError, UsageError, OSError) as error:  # OSError: a disk that fills up, a pipe that closes
        print(f"coopmm: error: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("coopmm: interrupted", file=sys.stderr)
        return INTERRUPTED


def _run(argv: Sequence[str], own_process: bool) -> int:
    arguments, changes = overrides.split(argv)
    options, unknown = _parser().parse_known_args(arguments)
    if unknown:
        raise UserError(unknown[0], f"an option of coopmm {options.command}{_similar(unknown[0])}", "unknown")
    if not options.takes_overrides:
        if changes:
            raise UserError(f"--{next(iter(changes))}", "given to a command that runs a scenario", options.command)
    elif own_process:
        runtime.use_fast_compilation()
        runtime.use_compilation_cache()
    return options.run(options, changes)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="coopmm", description=coopmm_jax.__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"coopmm {coopmm_jax.__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)

    simulate = commands.add_parser(
        "simulate",
        help="simulate one scenario and print its metrics",
        usage="coopmm simulate SCENARIO [--section.field VALUE ...] [--precision P] [--out DIR]",
        epilog=_fields_help(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    simulate.add_argument("scenario", metavar="SCENARIO", help="a shipped scenario's name, or the path of a TOML file")
    simulate.add_argument("--precision", choices=("float64", "float32"), help="short for --simulation.precision")
    simulate.add_argument(
        "--out", metavar="DIR", help="folder for scenario.toml, trajectory.npz, summary.json and overview.png"
    )
    simulate.set_defaults(run=_simulate, takes_overrides=True)

    scenarios = commands.add_parser("scenarios", help="list the shipped scenarios", allow_abbrev=False)
    scenarios.set_defaults(run=_scenarios, takes_overrides=False)
    return parser


def _scenarios(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    described = list_scenarios()
    width = max(map(len, described))
    for name, description in described.items():
        print(f"{name:{width}}  {description}")
    return DONE


def _simulate(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    if options.precision:
        changes = changes | {"simulation.precision": options.precision}
    scenario = load_scenario(options.scenario, **changes)
    if options.out is None:
        return _report(scenario, coopmm_jax.simulate(scenario))
    from coopmm_jax import plotting  # imports matplotlib

    with result_folder(options.out) as folder:
        trajectory = coopmm_jax.simulate(scenario)
        write_run(folder, scenario, trajectory)
        plotting.save(plotting.overview(trajectory), folder / "overview.png")
    code = _report(scenario, trajectory)
    print(f"written to {options.out}")
    return code


def _report(scenario: Scenario, trajectory: Any) -> int:
    settings = scenario.simulation
    print(scenario.description)
    print(f"{settings.duration:g} s in {scenario.steps} steps of {settings.step:g} s, {settings.precision}")
    for name in SHOWN:
        unit, meaning = METRICS[name]
        print(f"  {name:{max(map(len, SHOWN))}} {trajectory.metrics[name]:12.6g} {unit:6}  {meaning}")
    if trajectory.ok:
        return DONE
    ending = f"{trajectory.status.name} at t = {trajectory.status_time:g} s: {trajectory.status.message}"
    print(f"coopmm: rollout failed: {ending}", file=sys.stderr)
    return ROLLOUT_FAILED


def _sections() -> dict[str, Any]:
    fields = {name: field.annotation for name, field in Scenario.model_fields.items()}
    return {name: section for name, section in fields.items() if hasattr(section, "model_fields")}


def _option(section: str, field: str) -> str:
    return f"--{section}.{field.replace('_', '-')}"


def _similar(unknown: str) -> str:
    options = [_option(name, field) for name, section in _sections().items() for field in section.model_fields]
    return closest(unknown, [*options, "--out", "--precision"])


def _fields_help() -> str:
    """Every field that an override can name, with its default, meaning and unit."""
    lines = ["overrides, after SCENARIO (values are TOML; several values make a list, one number fills a list):"]
    for name, section in _sections().items():
        lines += ["", section.__doc__]
        for field, info in section.model_fields.items():
            choices = get_args(info.annotation) if get_origin(info.annotation) is Literal else ()
            meaning = info.description + (": " if choices else "") + " or ".join(choices)
            lines.append(f"  {_option(name, field):28} {meaning} (default {_default(info.default)})")
    return "\n".join(lines)


def _default(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_default, value))
    if value is None:
        return "the plant's"
    return f"{value:g}" if isinstance(value, float) else str(value)
