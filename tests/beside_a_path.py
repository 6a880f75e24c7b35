"""Runs along a path that several tests look at: parameters and starts from the study behind them."""

import coopmm_jax as cm
from coopmm_jax.kinds.courses import Sine, Swing
from coopmm_jax.kinds.paths import Fourier
from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.kinds.timings import Rate
from coopmm_jax.parameters import Gains, MovingRail, Parameters, PathReference, Pose, Rail, Structure

FULL = Structure(feedforward="full")
# As Fourier paths, so that one compiled program does for all.
ELLIPSE = Fourier(0.0, 0.0, (1.7, 0.0), (0.0, 0.0), (0.0, 0.0), (1.2, 0.0))
EIGHT = Fourier(0.0, 0.0, (0.0, 0.0), (3.0, 0.0), (0.0, 0.0), (0.0, 1.2))
CIRCLE = Fourier(0.0, 0.0, (1.7, 0.0), (0.0, 0.0), (0.0, 0.0), (1.7, 0.0))
ARC = Conic(1.0 / 0.7, 1.0 / 0.7)
# Close to a circle, so that platforms on two axles can follow; one harmonic, which compiles faster.
ROUND = Fourier(0.0, 0.0, (1.7,), (0.0,), (0.0,), (1.6,))
_GUESS = ((-0.795399, 1.590798), (2.346194, 1.590798))  # a2, a3


def parameters(path, timing, platforms, guide):
    """Parameters of a run with its force 15 + 5 sin t, from the poses (x, y, th, a1) of both robots."""
    paper = Parameters()
    guides = {"rail": Rail(path, timing.start), "moving": MovingRail(path, timing), "free": None}
    return paper._replace(
        plant=paper.plant._replace(guide=guides[guide]),
        gains=Gains(delta_floor=0.1),
        reference=PathReference(path, timing, contact=Swing(), contact_force=Sine(15.0, 5.0)),
        start=tuple(Pose(*four, *guess) for four, guess in zip(platforms, _GUESS, strict=True)),
    )


def at_level(start, shape=ARC):
    """Parameters of a run with another surface of the object, by default the paper's arc as a level."""
    surface = start.plant.surface._replace(shape=shape)
    return start._replace(
        plant=start.plant._replace(surface=surface), reference=start.reference._replace(surface=surface)
    )


def ellipse(guide="rail", ramp=0.5, away=0.1):
    """Along the ellipse, from ``away`` [m] outside of each platform's path."""
    platforms = ((2.4 + away, 0.0, 0.0, 1.097198), (1.0 + away, 0.0, 0.0, 1.570796))
    return parameters(ELLIPSE, Rate(1.0, 0.0, 0.3, 1.0, ramp), platforms, guide)


def eight(guide="rail"):
    """Along the figure of eight, whose yaw rate u_d1 changes sign."""
    platforms = ((1.847571, 0.381803, -1.113137, 1.097198), (1.228982, 1.637728, -1.113137, 1.570796))
    return parameters(EIGHT, Rate(0.7, 0.5), platforms, guide)


def round_about():
    """Along ROUND, from 0.1 m outside of each platform's path, with gains for a chain of four errors."""
    platforms = ((2.5, 0.0, 0.0, 1.097198), (1.1, 0.0, 0.0, 1.570796))
    start = parameters(ROUND, Rate(1.0, 0.0, 0.3, 1.0, 0.5), platforms, "rail")
    return start._replace(gains=Gains(k2=3.0, k3=3.0, k4=3.0, delta_floor=0.1))


ALONG = {
    "path": {"kind": "ellipse"},
    "timing": {"kind": "rate", "sway": 0.3},
    "force": {"kind": "sine", "mean": 15.0, "amplitude": 5.0},
    "contact": {"kind": "swing"},
}
START = {"x": [2.5, 1.1], "y": 0.0, "th": 0.0, "a1": [1.097198, 1.570796]}
START |= {"a2": [-0.795399, 2.346194], "a3": 1.590798}


def scenario(**overrides):
    """``ellipse`` as a scenario."""
    return cm.load_scenario(
        "paper_full", **{"reference": ALONG, "initial": START, "law": {"delta_floor": 0.1}} | overrides
    )
