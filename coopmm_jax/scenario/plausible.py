"""Inertias that do not go with the masses and lengths beside them, as when a user's own robot inherits the paper's.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> implausible(load_scenario("paper"))
[]
>>> implausible(load_scenario("paper", plant={"l2": 0.1}))
['plant.I2: 0.5 kg m^2 is 6.25 times what fits mass and size of robot I, and is the value of the paper']
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.errors import Notice
from coopmm_jax.parameters import Geometry, Inertia

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario

MOST = 2.5  # times the paper's own proportions, which are generous
_MISMATCH = 4.0  # between the controller's model and the plant

# The mass [kg] and the length [m] that a moment of inertia goes with.
_GOES_WITH: dict[str, Callable[[Geometry, Inertia], tuple[Scalar, Scalar]]] = {
    "I_w": lambda g, i: (i.m_p + i.m1 + sum((i.m2, i.m3) if i.links is None else i.links.m_links), g.r),
    "I_p": lambda g, i: (i.m_p, math.hypot(g.l, g.d)),
    "I1": lambda g, i: (i.m1, g.l1),
    "I2": lambda g, i: (i.m2, g.l2),
    "I3": lambda g, i: (i.m3, g.l3),
}


def warn_of(scenario: Scenario) -> None:
    """Warn of what is ``implausible``.

    Warns:
        Notice: once for each.
    """
    for text in implausible(scenario):
        warnings.warn(Notice(text), stacklevel=3)


def implausible(scenario: Scenario) -> list[str]:
    """Complaints about moments of inertia of the plant and of the controller's model."""
    parameters = scenario.parameters()
    plant = parameters.plant
    found = [*_too_large(plant.geometry, plant.inertia)]
    for name in _GOES_WITH:
        for robot, true, believed in zip(("I", "II"), plant.inertia, parameters.nominal, strict=True):
            ratio = _over(getattr(believed, name), getattr(true, name))
            if not 1.0 / _MISMATCH <= ratio <= _MISMATCH:
                found.append(f"nominal.{name}: the controller takes it for {ratio:.3g} times that of robot {robot}")
                break
    return found


def _too_large(geometry: tuple[Geometry, Geometry], inertia: tuple[Inertia, Inertia]) -> Iterator[str]:
    """A complaint for each moment of inertia, about the first robot whose it is."""
    for name in _GOES_WITH:
        usual = _proportion(name, Geometry(), Inertia())
        for robot, sizes, masses in zip(("I", "II"), geometry, inertia, strict=True):
            if name in ("I2", "I3") and masses.links is not None:  # told link by link
                continue
            times, value = _proportion(name, sizes, masses) / usual, getattr(masses, name)
            if times > MOST:
                inherited = ", and is the value of the paper" if value == getattr(Inertia(), name) else ""
                felt = f": like {_over(value, float(sizes.r * sizes.r)):.3g} kg at each wheel" if name == "I_w" else ""
                expected = f"{times:.3g} times what fits mass and size of robot {robot}"
                yield f"plant.{name}: {value:g} kg m^2 is {expected}{inherited}{felt}"
                break


def _proportion(name: str, geometry: Geometry, inertia: Inertia) -> float:
    """Moment of inertia over the mass and the square of the length that it goes with [-]."""
    mass, length = _GOES_WITH[name](geometry, inertia)
    return _over(getattr(inertia, name), float(mass * length * length))


def _over(number: float, divisor: float) -> float:
    return number / divisor if divisor else math.inf
