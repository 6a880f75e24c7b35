"""Pictures of README.md: the contact force under both readings of the feed-forward, the robots driving, and what
tuned gains bring on robots that they were not tuned on (docs/tuned.toml, which ``coopmm tune sensed`` has written).

    python -m experiments.readme_media [--out docs]

Exit codes: 0 done, 2 the folder cannot be written (one line on stderr).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import coopmm_jax as cm
from coopmm_jax import plotting, runtime
from coopmm_jax.animation.film import animate
from coopmm_jax.commands import BAD_INPUT, DONE
from coopmm_jax.files import result_folder
from tuning.reports.compare_figures import bands
from tuning.studies.compare import compare_gains

TUNED = Path(__file__).parent.parent / "docs" / "tuned.toml"
TURN = 6.28  # [s] in which the robots drive once round their circles
SAMPLES = 32  # of the uncertainty
WIDTH = 640  # [pixel] of the animation: legible, and small enough for a page that is read over a slow line


def main(argv: Sequence[str] | None = None) -> int:
    """Write ``contact_force.png``, ``robots.gif`` and ``tuning.png``.

    Args:
        argv: the arguments; by default those of the process, which is then taken to run nothing else, so that XLA's
            options for fast compilation and the compilation cache are switched on.

    Returns:
        The exit code.
    """
    parser = argparse.ArgumentParser(prog="readme_media", description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--out", metavar="DIR", default="docs", help="folder for the pictures (%(default)s)")
    folder = parser.parse_args(argv).out
    if argv is None:
        runtime.use_fast_compilation()
        runtime.use_compilation_cache()
    try:
        write_media(folder)
    except (cm.UserError, OSError) as error:  # OSError: a disk that fills up
        print(f"readme_media: error: {error}", file=sys.stderr)
        return BAD_INPUT
    print(f"contact_force.png, robots.gif and tuning.png are in {folder}")
    return DONE


def write_media(
    folder: str | Path, force_time: float = 20.0, robots_time: float = TURN, tuned_time: float = 20.0
) -> None:
    """Simulate, and write all pictures into a folder; they are there only when all are complete.

    Args:
        folder: for the pictures.
        force_time: extent of the run whose contact force is shown [s].
        robots_time: extent of the run that is filmed [s].
        tuned_time: extent of the runs with tuned gains [s].

    Raises:
        UserError: the folder cannot be written.
    """
    with result_folder(folder) as results:
        runs = [_run(name, force_time) for name in ("paper", "paper_full")]
        plotting.save(plotting.contact_force(*runs, labels=["paper", "paper_full"]), results / "contact_force.png")
        animate(_run("paper_full", robots_time), path=results / "robots.gif", width=WIDTH)
        sensed = cm.load_scenario("sensed", simulation={"duration": tuned_time})
        compared = compare_gains(sensed, ["scenario", TUNED], samples=SAMPLES)
        plotting.save(bands(compared), results / "tuning.png")


def _run(name: str, duration: float) -> cm.Trajectory:
    return cm.simulate(cm.load_scenario(name, simulation={"duration": duration}))


if __name__ == "__main__":
    sys.exit(main())
