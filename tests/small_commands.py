"""Sizes that make the commands of the documentation small, so that tests can carry out all of them."""

import shlex

HORIZON = 0.04  # [s]: one segment of a batch's rollout, see ``coopmm_jax/sweeps/measure.py``
SHORT = ["--simulation.duration", str(HORIZON)]
# Gains and cost of the tutorials at small size, whose programs these are, and of all experiments.
COST = {"channels": "shared", "tracking_from": HORIZON / 2}
FEW = {"starts": 4, "samples": 2, "screening_samples": 2, "validation_samples": 4, "test_samples": 4, "budget": 0.01}
FEW |= {"precision": "float64"}  # one program less to compile
SHORT_TUNING = [*SHORT, *(word for name, value in (COST | FEW).items() for word in (f"--tuning.{name}", str(value)))]
COMPARED = [*SHORT_TUNING, "--samples", "4"]
# In batches as large as those that tuning and comparing measure, whose programs these are.
SWEPT = shlex.split("--samples 16 --batch 32 --keep 2")

# Of the READMEs: every command, with the words that make it small (the worker makes small what has no option for it).
README = {
    "python -m experiments.reproduce_paper --out results/paper": ["--duration", str(HORIZON)],
    "coopmm simulate sensed --gains.K-lambda 2 --out results/run": SHORT,
    "coopmm animate paper --against paper_full --out results/robots.gif": SHORT,
    "coopmm scenarios sensed": [],
    "coopmm init mine.toml --scenario sensed --plant.m-p 30": [],
    "coopmm help loop --scenario sensed": [],
    "coopmm metrics": [],
    "coopmm sweep sensed --samples 1000 --out results/sensed.zarr": [*SHORT, *SWEPT],
    "coopmm tune sensed --out results/tuned": SHORT_TUNING,
    "coopmm watch results/tuned": [],
    "coopmm simulate sensed --gains-file results/tuned": SHORT,
    "coopmm compare scenario results/tuned --scenario sensed --out results/compared": COMPARED,
    "coopmm tune sensed --pareto 5 --out results/front": [*SHORT_TUNING, "--pareto", "2"],
    "coopmm falsify sensed --out results/worst.toml": [*SHORT_TUNING, "--rollouts", "40", "--starts", "4"],
    "coopmm falsify sensed --modes 4 --out results/failures": [
        *(*SHORT_TUNING, "--rollouts", "40", "--starts", "4"),
        *("--requirements.force-error-rms-late", "none"),  # the others speak of signals that the command above draws
    ],
    "coopmm check results/failures --gains-file results/tuned": [
        *shlex.split("--requirements.contact-loss-fraction '<= 1' --requirements.force-error-rms-late '<= 1e3'"),
        *shlex.split("--requirements.object-rms '<= 1e3' --requirements.error-late '<= 1e3'"),
    ],
    "coopmm tune sensed --adversarial --out results/hardened": SHORT_TUNING,
    "coopmm report results/sensed.zarr": [],
    "coopmm simulate --from results/sensed.zarr --sample 12": [],
    "coopmm simulate --help": [],
    "coopmm --print-completion bash": [],
    "python -m coopmm_jax": ["--version"],
    "coopmm simulate ellipse --reference.path.half-width 1.4 --out results/ellipse": SHORT,
    "python -m experiments.reproduce_paper": ["--duration", str(HORIZON)],
    "python -m experiments.paper_checks": ["u26"],
    "python -m experiments.fingerprints": shlex.split("--scenarios paper --parts trajectory"),
    "python -m experiments.fuzz": ["--cases", "20"],
    "python -m experiments.fuzz_kinds": ["--cases", "1"],
    "python -m experiments.readme_media": [],
    "python -m experiments.benchmarks.rollout": ["--rounds", "1"],
    "python -m experiments.benchmarks.loops": ["--rounds", "1"],
    "python -m experiments.benchmarks.accelerator": shlex.split(
        "--batches 2 --steps 1 --scenarios free --precisions float64"
    ),
    "python -m experiments.benchmarks.sweep": [],
    "python -m experiments.benchmarks.gradients": ["--duration", str(HORIZON)],
    "python -m experiments.benchmarks.falsify": shlex.split("--samples 700 --seeds 1"),
    "python -m experiments.benchmarks.tuning_quality": shlex.split("--scenario short_tuning.toml --seeds 1"),
    "python -m experiments.benchmarks.tuners": shlex.split(
        "--problems shared --tuners coopmm nelder_mead --seeds 1 --seconds 0.5"
    ),
}

# Windows that begin within a short run; what else the sentences say is as on the page.
TIMELY = [
    *(*SHORT, "--requirements.keeps-pressing", "always[0.02, 20] contact_force >= 5"),
    *("--requirements.follows.require", "always[0.02, inf] abs(contact_force - desired_force) <= 3"),
]
# Of the guide: words that make small what begins so; none where the scenario file that is named is small itself.
GUIDE = {
    "coopmm init mine.toml": [*SHORT_TUNING, *shlex.split("--loop.control-period 0.001")],
    "coopmm init round.toml": [*SHORT, *shlex.split("--reference.path.order 1 --reference.path.tolerance 1")],
    "coopmm init": SHORT,
    "coopmm help": [],
    "coopmm simulate mine.toml": [],
    "coopmm simulate sensed": SHORT,
    "coopmm simulate": [],
    "coopmm simulate timely.toml": TIMELY,
    "coopmm sweep mine.toml": SWEPT,
    "coopmm sweep timely.toml": [*TIMELY, *SWEPT],
    "coopmm sweep sensed --samples 4096 --rank": [*SHORT, *shlex.split("--samples 64 --batch 32 --keep 2")],
    "coopmm sweep sensed --samples 8192 --resume": [*SHORT, *shlex.split("--samples 96 --batch 32 --keep 2")],
    "coopmm sweep": [*SHORT, *SWEPT],
    "coopmm tune": [*SHORT_TUNING, *shlex.split("--tuning.optimiser cma")],
    "coopmm compare": COMPARED,
    "coopmm report": [],
    "coopmm falsify": [],  # in the text alone, as the next
    "coopmm check": [],
}

# Of the pages on plugins and controllers: words that make small the commands with these words.
PLUGINS = {
    "simulate --from": [],
    "simulate": SHORT,
    "sweep": [*SHORT, *SWEPT],
    "tune": SHORT_TUNING,
    "falsify": [*SHORT_TUNING, "--rollouts", "20", "--starts", "2"],
    "animate": ["--width", "400", "--fps", "50"],
    "compare": COMPARED,
}
