"""Pictures of shipped scenarios for the documentation: the robots in the middle of a run, paths, a tip knocked off.

    python -m experiments.scenario_pictures [--out docs]

Exit codes: 0 done, 2 the folder cannot be written (one line on stderr).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

import coopmm_jax as cm
from coopmm_jax import plotting, runtime
from coopmm_jax.animation.stage import stage
from coopmm_jax.commands import BAD_INPUT, DONE
from coopmm_jax.files import result_folder
from coopmm_jax.plotting.lines import runs

WIDTH = 640  # of a frame [pixel]
FRAMES = ("paper", "paper_full", "uncertain", "sensed", "free", "rough", "flat", "trailer", "mixed", "long_arm")
KNOCKED = (3.95, 4.45)  # [s], when the tip of `compliant` is off the surface, and a little more


def main(argv: Sequence[str] | None = None) -> int:
    """Write a picture of each scenario: of a moment, of its path, and of the gap of ``compliant``.

    Args:
        argv: the arguments; by default those of the process, which is then taken to run nothing else.

    Returns:
        The exit code.
    """
    parser = argparse.ArgumentParser(prog="scenario_pictures", description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--out", metavar="DIR", default="docs", help="folder for the pictures (%(default)s)")
    folder = parser.parse_args(argv).out
    if argv is None:
        runtime.use_fast_compilation()
        runtime.use_compilation_cache()
    knocked = cm.load_scenario("compliant", simulation={"duration": KNOCKED[1]})
    try:
        with result_folder(folder) as results:
            for name in FRAMES:
                plotting.save(frame(cm.simulate(name), 9.0), results / f"{name}.png")
            for name in ("ellipse", "eight", "waypoints"):
                plotting.save(plotting.platform_paths(cm.simulate(name)), results / f"{name}.png")
            compared = {f"K_lambda = {gain:g}": knocked.with_overrides({"gains.K_lambda": gain}) for gain in (0.3, 1.0)}
            plotting.save(gaps({label: cm.simulate(one) for label, one in compared.items()}), results / "compliant.png")
    except (cm.UserError, OSError) as error:  # OSError: a disk that fills up
        print(f"scenario_pictures: error: {error}", file=sys.stderr)
        return BAD_INPUT
    return DONE


def frame(run: cm.Trajectory, time: float) -> Figure:
    """Film of a run, stopped at a time [s]."""
    figure, views = stage(runs([run], None), np.array([0.0, time, run.t[-1]]), WIDTH)
    for view in views:
        view.show(1)
    return figure


def gaps(compared: Mapping[str, cm.Trajectory]) -> Figure:
    """Gap between tip and surface of runs by label [mm], around the knock; negative where the tip is pressed in."""
    first = next(iter(compared.values()))
    shown = (first.t >= KNOCKED[0]) & (first.t <= KNOCKED[1])
    gap = {label: 1e3 * run.constraint_residual[shown, 0] for label, run in compared.items()}
    return plotting.series(first.t[shown], gap, "gap [mm]")


if __name__ == "__main__":
    sys.exit(main())
