"""The verdict on one step: which quantity ended a rollout."""

from types import SimpleNamespace

import pytest

from coopmm_jax.control.robust_adaptive import ControllerState
from coopmm_jax.loop.health import judge, within
from coopmm_jax.status import CONTROLLER_LIMIT, SINGULAR_FRACTION, SPEED_LIMIT, Status

NAN = float("nan")


def verdict(velocity=0.0, eta=0.0, determinants=(1.0, 1.0)):
    """Of a step from determinants (-2, 4) at the start, as a fraction of them, to one velocity and one eta."""
    controller = ControllerState((0.0, 0.0), (eta, 0.0), (1.0,) * 5, (0.0,) * 4)
    proposed = SimpleNamespace(velocity=(0.0, velocity), controller=controller)
    start = (-2.0, 4.0)
    signals = SimpleNamespace(determinants=tuple(x * y for x, y in zip(determinants, start, strict=True)))
    return Status(int(judge(proposed, signals, start)))


@pytest.mark.parametrize(
    ("seen", "status"),
    [
        ({}, Status.OK),
        ({"velocity": 0.99 * SPEED_LIMIT, "eta": -0.99 * CONTROLLER_LIMIT}, Status.OK),
        ({"velocity": -1.01 * SPEED_LIMIT}, Status.SPEED),
        ({"velocity": NAN}, Status.SPEED),
        ({"eta": 1.01 * CONTROLLER_LIMIT}, Status.CONTROLLER),
        ({"eta": NAN}, Status.CONTROLLER),
        ({"determinants": (0.99 * SINGULAR_FRACTION, 1.0)}, Status.SINGULAR_CONTACT),
        ({"determinants": (-1.0, 1.0)}, Status.SINGULAR_CONTACT),
        ({"determinants": (1.0, 0.99 * SINGULAR_FRACTION)}, Status.SINGULAR_GUIDE),
        ({"determinants": (1.0, NAN)}, Status.SINGULAR_GUIDE),
        # The cause before its consequences: a singular arm makes everything diverge, speeds before integrals.
        ({"velocity": NAN, "eta": NAN}, Status.SPEED),
        ({"velocity": NAN, "determinants": (0.0, 1.0)}, Status.SINGULAR_CONTACT),
    ],
)
def test_verdict(seen, status):
    assert verdict(**seen) is status


def test_within():
    assert within((1.0, -1.9), 2.0)
    assert not within((1.0, -2.1), 2.0)
    assert not within((1.0, float("inf")), 2.0)


def test_every_outcome_has_a_message_of_its_own():
    messages = [status.message for status in Status]
    assert len(set(messages)) == len(Status)
    assert all("\n" not in message for message in messages)
