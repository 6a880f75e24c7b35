"""Tuning problem on which tuners are compared: one cost, fixed sets of robots, and a meter of simulated steps.

The paper's loop with a force sensor that lags 5 ms, 64 robots with masses 20 % off and up to four times the paper's
disturbance, 4 s, mean over the robots of the time average of

    10 sum(e1^2 + e2^2 + s3^2 of both robots) + (a1 error of robot I)^2 + ((lambda_n - 15) / 15)^2
    + 0.1 sum((other lambda / 15)^2) + 10 max(-lambda_n / 15, 0)^2 + 1e-5 |actuator force in the coordinates of u|^2
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.control.reference import desired_force, desired_motion
from coopmm_jax.loop.state import Signals
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.robot_kinematics import actuator_force
from coopmm_jax.parameters import Parameters
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.variation import vary
from tuning.cost.evaluate import Samples
from tuning.cost.objective import TERMS, Objective
from tuning.cost.risk import risk
from tuning.search.method import Search

ROBOTS = 64  # of a set
DURATION = 4.0  # [s]
GRADIENT = 8  # rollouts that one gradient by reverse mode costs (benchmarks.rollout measures it)
FORCE = 15.0  # [N]
COEFFICIENTS = {
    "posture": 10.0,
    "relative": 1.0,
    "force": 1.0 / FORCE**2,
    "internal": 0.1 / FORCE**2,
    "contact_loss": 10.0 / FORCE**2,
    "effort": 1e-5,
}
UNCERTAINTY = {
    "plant.masses": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True},
    "disturbance.scale": {"distribution": "uniform", "low": 0.0, "high": 4.0},
}
TRAINING, HELD_OUT, OWN = 0, 1_000_000, 2_000_000  # first indices of the sets; ours draws its subsets from OWN on


class ComparisonObjective(Objective):
    """Cost above; its terms go by the names of the tuner's own."""

    def sample_terms(self, parameters: Parameters, t: Scalar, signals: Signals) -> dict[str, Scalar]:
        """Terms of one sample at t [s]; zero for those that this cost does not have."""
        desired = desired_motion(parameters.reference, t)
        tracking = 0.0 * t
        for p, d in zip(signals.position, desired, strict=True):
            e2 = p.z2 - d.z2
            s3 = p.z3 - d.z3 + parameters.gains.k2 * e2 * parameters.reference.rate
            tracking += (p.z1 - d.z1) ** 2 + e2**2 + s3**2
        wanted = desired_force(parameters.reference, self.structure.rows)
        _, *others = (x - d for x, d in zip(signals.constraint_force, wanted, strict=True))
        geometry = build_model(parameters).geometry
        forces = (actuator_force(*robot) for robot in zip(geometry, signals.position, signals.commanded, strict=True))
        return dict.fromkeys(TERMS, 0.0 * t) | {
            "posture": tracking,
            "relative": (signals.position[0].a1 - desired[0].arm[0]) ** 2,
            "force": signals.force_error[0] ** 2,
            "internal": sum(x**2 for x in others),
            "contact_loss": jnp.minimum(signals.constraint_force[0], 0.0) ** 2,
            "effort": sum(x**2 for force in forces for x in force),
        }


class Clock(NamedTuple):
    """Wall time and CPU time of all cores [s]: the work of others slows down the first alone."""

    wall: float
    cpu: float

    @classmethod
    def now(cls) -> Clock:
        """Readings now, whose differences count."""
        return cls(time.perf_counter(), time.process_time())

    def __sub__(self, other: Clock) -> Clock:
        return Clock(self.wall - other.wall, self.cpu - other.cpu)


class Improvement(NamedTuple):
    """Best gains of a run so far, with the steps and the time taken."""

    steps: float  # simulated
    taken: Clock  # without compilation
    differentiated: bool
    vector: np.ndarray  # (n,)


@dataclass
class Meter:
    """Search that every tuner is given; it counts simulated steps and notes every improvement."""

    search: Search
    budget: float  # [simulated steps]
    steps: float = 0.0
    clock: Clock = field(default_factory=lambda: Clock.now())
    differentiated: bool = False  # true once gradients, which take a program of their own, have been asked for
    trail: list[Improvement] = field(default_factory=list)

    def values(self, vectors: np.ndarray, samples: Samples) -> np.ndarray:
        """Mean cost of every candidate (C,); vectors are (C, n)."""
        self.steps += len(vectors) * len(samples) * self.search.objective.steps
        return self.search.values(vectors, samples)

    def slopes(self, vectors: np.ndarray, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
        """Mean cost of every candidate (C,) and its gradient (C, n)."""
        self.differentiated = True
        self.steps += GRADIENT * len(vectors) * len(samples) * self.search.objective.steps
        return self.search.slopes(vectors, samples)

    def note(self, vector: np.ndarray) -> None:
        """Note the vector (n,) of the best gains so far; findings beyond the budget do not count."""
        if self.steps > self.budget:
            return
        taken = Clock.now() - self.clock
        self.trail.append(Improvement(self.steps, taken, self.differentiated, np.array(vector)))

    @property
    def spent(self) -> bool:
        """True once the budget is used up."""
        return self.steps >= self.budget


def scenario(channels: str) -> Scenario:
    """Scenario of the problem; ``channels`` is shared (4 numbers) or separate (19)."""
    return load_scenario(
        "paper",
        simulation={"duration": DURATION},
        law={"delta_floor": 0.01},
        sensing={"force_lag": 0.005},
        uncertainty=UNCERTAINTY,
        tuning={"channels": channels, "horizon": DURATION, "tracking_from": 0.0},
    )


def build(channels: str) -> tuple[Search, Samples, Samples]:
    """Search, and the fixed sets of robots for training and for judging."""
    chosen = scenario(channels)
    objective = ComparisonObjective.of(chosen, vary(chosen).structure(), DURATION)
    coefficients = np.array([COEFFICIENTS.get(name, 0.0) for name in TERMS])
    search = Search(objective, coefficients, risk("mean"))
    return search, samples(TRAINING, ROBOTS), samples(HELD_OUT, ROBOTS)


def samples(first: int, count: int, seed: int = 0) -> Samples:
    """Robots ``first`` to ``first + count - 1`` of a seed; shared and separate gains meet the same ones."""
    variation = vary(scenario("shared"))
    indices = range(first, first + count)
    return Samples(variation.batch(sampler("independent", seed, len(variation.draws))(indices), indices))
