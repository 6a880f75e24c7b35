"""``coopmm simulate``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import coopmm_jax
from coopmm_jax.commands import DONE, ROLLOUT_FAILED
from coopmm_jax.commands.fields import OVERRIDES, fields_help
from coopmm_jax.commands.options import add_gains_file, add_overwrite, check_out, with_gains
from coopmm_jax.errors import UserError, one_line
from coopmm_jax.files import resolve_path, result_folder
from coopmm_jax.metrics.table import METRICS, as_text, shown
from coopmm_jax.runs.store import write_run
from coopmm_jax.scenario.scenario import Scenario, load_scenario

if TYPE_CHECKING:
    from coopmm_jax.commands import Subparsers
    from coopmm_jax.runs.trajectory import Trajectory

_WIDEST = 1000  # characters of a description that are printed


def add(commands: Subparsers) -> None:
    """Declare the subcommand."""
    parser = commands.add_parser(
        "simulate",
        help="simulate one scenario and print its metrics",
        usage=f"coopmm simulate (SCENARIO | --from STORE --sample N) {OVERRIDES} [--precision P] [--out DIR]",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "scenario", metavar="SCENARIO", nargs="?", help="a shipped scenario's name, or the path of a TOML file"
    )
    parser.add_argument("--from", dest="store", metavar="STORE", help="a sweep's store, to replay one of its samples")
    parser.add_argument("--sample", metavar="N", type=int, help="which sample of STORE, counted from 0")
    add_gains_file(parser)
    parser.add_argument("--precision", choices=("float64", "float32"), help="short for --simulation.precision")
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="folder for scenario.toml, trajectory.npz, summary.json, metrics.csv and overview.png",
    )
    add_overwrite(parser)
    parser.set_defaults(run=run, parser=parser, epilog=fields_help, takes_overrides=True, computes=True)


def run(options: argparse.Namespace, changes: dict[str, Any]) -> int:
    """Simulate, print, and write results if a folder is named.

    Raises:
        UserError: not one source of the scenario, results that are there already, or as ``load_scenario``,
            ``replay``, ``read_gains`` and ``simulate``.
    """
    changes = with_gains(options, changes)
    if options.precision:
        changes = changes | {"simulation.precision": options.precision}
    scenario = _scenario(options, changes)
    if options.out is None:
        return _report(scenario, coopmm_jax.simulate(scenario))
    target = resolve_path(options.out, "--out")
    check_out(options, target)
    with result_folder(target) as folder:
        trajectory = coopmm_jax.simulate(scenario)
        write_run(folder, scenario, trajectory)
    code = _report(scenario, trajectory)
    from coopmm_jax import plotting  # imports matplotlib
    from coopmm_jax.plotting import style

    style.publish(target, {"overview.png": lambda: plotting.overview(trajectory)})
    print(f"written to {target}")
    return code


def _scenario(options: argparse.Namespace, changes: dict[str, Any]) -> Scenario:
    """Scenario that is named, or the one of a sweep's sample."""
    if options.store is None:
        if options.sample is not None:
            raise UserError("--sample", "given together with --from", "given alone")
        if options.scenario is None:
            raise UserError("SCENARIO", "given, or --from STORE --sample N", "missing")
        return load_scenario(options.scenario, **changes)
    if options.scenario is not None:
        raise UserError("--from", "given in place of SCENARIO", f"given with {options.scenario}")
    if options.sample is None:
        raise UserError("--sample", "given together with --from", "missing")
    from coopmm_jax.sweeps.replay import replay  # imports zarr

    return replay(options.store, options.sample).with_overrides(changes)


def _report(scenario: Scenario, trajectory: Trajectory) -> int:
    settings = scenario.simulation
    if not trajectory.ok:
        print(f"failed at {trajectory.status_time:g} of {settings.duration:g} s: {trajectory.status.message}")
    print(one_line(scenario.description, _WIDEST))
    steps = scenario.steps * max(1, scenario.structure().substeps)
    print(f"{settings.duration:g} s in {steps} steps of {settings.step:g} s, {settings.precision}")
    width = max(map(len, shown()))
    for name in shown():
        value = as_text(trajectory.metrics[name], ".6g")
        print(f"  {name:{width}} {value:>12} {METRICS[name].unit:6}  {METRICS[name].meaning}")
    for line in _requirements(scenario, trajectory):
        print(f"  requirement {line}")
    if trajectory.ok:
        return DONE
    ending = f"{trajectory.status.name} at t = {trajectory.status_time:g} s: {trajectory.status.message}"
    print(f"coopmm: rollout failed: {ending}", file=sys.stderr)
    return ROLLOUT_FAILED


def _requirements(scenario: Scenario, trajectory: Trajectory) -> Iterator[str]:
    """Each requirement, whether it is met, and by how much."""
    known = scenario.requirements.metrics()
    for requirement in scenario.requirements.parsed():
        value = trajectory.metrics[requirement.metric]
        if not trajectory.ok:
            yield f"{requirement}: not met"
            continue
        distance = requirement.robustness(value) * requirement.scale
        met = "met" if requirement.met(value) else "not met"
        yield f"{requirement}: {met} (robustness {distance:.4g} {known[requirement.metric].unit})"
