"""Robots, velocities, bounds and constraints that the entries of a gain belong to, in words."""

from __future__ import annotations

from coopmm_jax.kinds.controllers import ESTIMATE, ROW, VELOCITY, gains_of
from coopmm_jax.mechanics.partitioning import partition
from coopmm_jax.plotting.control import BOUNDS, velocities
from coopmm_jax.plotting.motion import ROBOTS
from coopmm_jax.scenario.scenario import Scenario


def entry_owners(scenario: Scenario) -> dict[str, str]:
    """Owner of each entry of the controller's gains, by the entry's label.

    >>> from coopmm_jax.scenario.scenario import load_scenario
    >>> owners = entry_owners(load_scenario("paper"))
    >>> owners["K_sigma[4]"], owners["gamma[0]"], owners["K_I[0]"]
    ('robot II, u2 driving', 'inertia', 'contact normal')
    """
    rows = scenario.structure().rows
    both = zip(ROBOTS, velocities(scenario), partition(rows, scenario.arm.joints).independent, strict=True)
    named = [f"robot {robot}, {names[joint]}" for robot, names, joints in both for joint in joints]
    names = {VELOCITY: named, ESTIMATE: BOUNDS, ROW: [row.replace("_", " ") for row in rows], None: ()}
    return {
        f"{gain}[{i}]": owner
        for gain, about in gains_of(scenario.parameters().gains).items()
        for i, owner in enumerate(names[about.per])
    }


def with_owner(label: str, owners: dict[str, str]) -> str:
    """Label of a tuned number, as K_sigma[4] or K_sigma[4]@t=2, and what it belongs to.

    >>> with_owner("K[1]@t=2", {"K[1]": "robot II"})
    'K[1]@t=2 robot II'
    """
    return f"{label} {owners.get(label.partition('@')[0], '')}".rstrip()
