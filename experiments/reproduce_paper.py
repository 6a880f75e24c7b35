"""Simulation study of the paper's section IV: Figs. 3-10, a summary, a short table.

    python -m experiments.reproduce_paper [--out results/paper] [--duration 20]

The study is run with both readings of the force feed-forward: ``projected``, the substitution after (40), on which all
figures are based, and ``full``, the form of (17), beside it in the contact force. The motion is the same with both.

Exit codes: 0 done, 2 the options cannot be used (one line on stderr), 3 a rollout failed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import coopmm_jax as cm
from coopmm_jax import plotting, runtime
from coopmm_jax.commands import BAD_INPUT, DONE, ROLLOUT_FAILED
from coopmm_jax.files import result_folder, write_json, write_text
from coopmm_jax.metrics.table import METRICS, SHOWN, as_text
from coopmm_jax.proof.lyapunov import Analysis, analyse, report
from coopmm_jax.runs.store import summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from coopmm_jax.runs.trajectory import Trajectory

Runs = dict[str, "Trajectory"]  # by feed-forward

READINGS = ("projected", "full")
ANALYSED = 10  # samples from one instant at which the Lyapunov function is evaluated to the next

# File -> caption in the paper, and how to draw it.
FIGURES: dict[str, tuple[str, Callable[[Runs], Figure]]] = {
    "fig03.png": (
        "Fig. 3. Tracking trajectories of both mobile platforms",
        lambda runs: plotting.platform_paths(runs["projected"]),
    ),
    "fig04.png": (
        "Fig. 4. Tracking of θ for mobile manipulator I",
        lambda runs: plotting.platform_angle(runs["projected"], robot="I"),
    ),
    "fig05.png": (
        "Fig. 5. Tracking of arm joint angles of mobile manipulator I",
        lambda runs: plotting.arm_angles(runs["projected"], robot="I"),
    ),
    "fig06.png": (
        "Fig. 6. Input torques for mobile manipulator I",
        lambda runs: plotting.torques(runs["projected"], robot="I"),
    ),
    "fig07.png": (
        "Fig. 7. Tracking of θ for mobile manipulator II",
        lambda runs: plotting.platform_angle(runs["projected"], robot="II"),
    ),
    "fig08.png": (
        "Fig. 8. Tracking of arm joint angles of mobile manipulator II",
        lambda runs: plotting.arm_angles(runs["projected"], robot="II"),
    ),
    "fig09.png": (
        "Fig. 9. Torques of mobile manipulator II",
        lambda runs: plotting.torques(runs["projected"], robot="II"),
    ),
    "fig10.png": (
        "Fig. 10. Contact force of relative motion",
        lambda runs: plotting.contact_force(*runs.values(), labels=tuple(runs)),
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study.

    Args:
        argv: the arguments; by default those of the process, which is then taken to run nothing else, so that XLA's
            options for fast compilation and the compilation cache are switched on.

    Returns:
        The exit code.

    Raises:
        SystemExit: options that cannot be used, with code 2.
    """
    parser = _parser()
    options = parser.parse_args(argv)
    if argv is None:
        runtime.use_fast_compilation()
        runtime.use_compilation_cache()
    try:
        with result_folder(options.out) as folder:
            runs = _simulate(options.duration)
            analysis = analyse(runs["projected"], every=ANALYSED)
            write_results(folder, runs, analysis)
    except (cm.UserError, OSError) as error:  # OSError: a disk that fills up
        parser.error(str(error))
    print(table(runs, analysis))
    print(f"\nFigs. 3-10 and summary.json are in {options.out}")
    return _outcome(runs)


def write_results(folder: Path, runs: Runs, analysis: Analysis) -> None:
    """Write Figs. 3-10, the scenarios, and ``summary.json``."""
    for name, (caption, draw) in FIGURES.items():
        figure = draw(runs)
        plotting.caption(figure, caption)
        plotting.save(figure, folder / name)
    for reading, run in runs.items():
        write_text(folder / f"{reading}.toml", run.scenario.to_toml())
    stability = report(analysis)
    content = {
        "runs": {reading: summary(run.scenario, run) for reading, run in runs.items()},
        "largest_constraint_residual": max(run.metrics["constraint_residual_max"] for run in runs.values()),
        "reduced_inertia_eigenvalues": stability.pop("inertia_eigenvalues"),
        "lyapunov": stability,
        "figures": {name: caption for name, (caption, _) in FIGURES.items()},
    }
    write_json(folder / "summary.json", content)


def table(runs: Runs, analysis: Analysis) -> str:
    """Table of the metrics that a reader wants first, and of the stability analysis, one line each."""
    width = max(map(len, SHOWN))
    lines = [f"{'feed-forward':{width}}" + "".join(f"{reading:>12}" for reading in runs)]
    for name in SHOWN:
        values = "".join(f"{as_text(run.metrics[name], '.4g'):>12}" for run in runs.values())
        lines.append(f"{name:{width}}{values} {METRICS[name].unit:6}  {METRICS[name].meaning}")
    stability = report(analysis)
    lowest, highest = stability["inertia_eigenvalues"]
    excess, at = (stability["bound_40"][key] for key in ("excess", "t"))
    verdict = f"exceeded by {excess:.4g} at {at:.4g} s" if excess > 0.0 else f"kept, with {-excess:.4g} to spare"
    return "\n".join(
        [
            *lines,
            f"eigenvalues of the reduced inertia: {lowest:.4g} to {highest:.4g}",
            f"bound (40) on the Lyapunov function's rate: {verdict}",
        ]
    )


def _simulate(duration: float) -> Runs:
    runs = {}
    for reading in READINGS:
        scenario = cm.load_scenario("paper", simulation={"duration": duration}, law={"feedforward": reading})
        print(f"simulating {duration:g} s with the feed-forward {reading} ...", flush=True)
        runs[reading] = cm.simulate(scenario)
    return runs


def _outcome(runs: Runs) -> int:
    """Exit code; a failure is reported on stderr."""
    failed = {reading: run for reading, run in runs.items() if not run.ok}
    for reading, run in failed.items():
        ending = f"{run.status.name} at t = {run.status_time:g} s: {run.status.message}"
        print(f"reproduce_paper: rollout {reading} failed: {ending}", file=sys.stderr)
    return ROLLOUT_FAILED if failed else DONE


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: error: {message}\n")


def _parser() -> _Parser:
    parser = _Parser(prog="reproduce_paper", description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--out", metavar="DIR", default="results/paper", help="folder for the results (%(default)s)")
    parser.add_argument(
        "--duration",
        metavar="SECONDS",
        type=float,
        default=20.0,
        help="simulated time, less for a quick look (%(default)g)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
