"""The rollout of the closed loop: its order, its horizon, how it ends, and that new numbers compile nothing."""

import jax
import numpy as np
import pytest

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.disturbances import Disturbance, Sine
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.status import Status

PAPER = Parameters()
POSE = PAPER.start[0]
REFERENCE = PAPER.reference
GAINS = PAPER.gains


@pytest.fixture(scope="module")
def program(programs):
    return programs(Structure())


def numbers(tree):
    return np.array(jax.tree.leaves(tree))


def test_order_four(program):
    horizon = 0.5
    exact = numbers(program(PAPER, horizon / program.STEPS, program.STEPS).state)
    steps = np.array([200, 250, 400, 500])
    errors = [np.abs(numbers(program(PAPER, horizon / n, n).state) - exact).max() for n in steps.tolist()]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(-4, abs=0.05)


def test_horizon_may_be_shorter_than_the_plan(program, paper_run):
    """The end of 1000 steps is sample 1000 of a longer run, bit for bit."""
    short = program(PAPER, steps=1000)
    at_end = jax.tree.map(lambda x: x[1000], paper_run.signals)
    assert np.array_equal(numbers(short.state.position), numbers(at_end.position))
    assert np.array_equal(numbers(short.state.controller), numbers(at_end.controller))
    for mine, longer in zip(jax.tree.leaves(short.signals), jax.tree.leaves(paper_run.signals), strict=True):
        assert np.array_equal(mine, longer[:1001])
    assert np.array_equal(short.t, np.arange(1001) * 1e-3)


def test_a_start_whole_turns_further_is_the_same_start(program, paper_run):
    """Heading, arm yaw and elbow of either robot, one or two turns off: the same motion, to rounding."""
    one, two = PAPER.start
    turned = one._replace(th=one.th + 2 * np.pi, a3=one.a3 - 2 * np.pi), two._replace(a1=two.a1 - 4 * np.pi)
    run = program(PAPER._replace(start=turned), steps=1000)
    for name in ("velocity", "torque", "constraint_force", "controller", "tip"):
        mine, its = (numbers(getattr(signals, name))[:, :1001] for signals in (run.signals, paper_run.signals))
        np.testing.assert_allclose(mine, its, rtol=0, atol=1e-9 * np.abs(its).max())


def test_no_step_at_all(program):
    run = program(PAPER, steps=0)
    assert run.t.tolist() == [0.0]
    assert np.array_equal(numbers(run.state.position), numbers(run.signals.position)[:, 0])


@pytest.mark.parametrize(("steps", "length", "segments"), [(10, 1, 11), (10, 5, 3), (9, 5, 2), (0, 7, 1)])
def test_plan_covers_both_ends(steps, length, segments):
    assert Plan.batch(steps, length) == Plan(segments, length)
    assert Plan.alone(steps, length) == Plan(segments, length, packed=True)
    assert Plan.gradient(steps, length) == Plan(segments, length, checkpoint=True, packed=True)


def test_more_steps_than_the_plan_has_room_for_are_refused():
    with pytest.raises(UserError, match="steps: must be at most 50, which the plan has room for, was 500"):
        rollout(Structure(), Parameters(), 1e-3, 500, Plan.alone(50))


def test_traced_steps_beyond_the_plan_are_a_failure(program):
    run = program(PAPER, steps=program.STEPS + 1)
    assert (run.health.status, run.health.step) == (Status.TOO_LONG, 0)
    assert np.array_equal(numbers(run.state.position), numbers(run.signals.position)[:, 0])


FAILURES = {
    "coarse step": (PAPER, {"step": 0.05, "steps": 100}, Status.SPEED),
    "robot I too far out": (
        PAPER._replace(reference=REFERENCE._replace(radius=(2.8, 1.0))),
        {},
        Status.SINGULAR_CONTACT,
    ),
    "unstable force loop": (PAPER._replace(gains=GAINS._replace(K_I=(-50.0,) * 4)), {}, Status.CONTROLLER),
    "start out of reach": (PAPER._replace(start=(POSE._replace(x=5.0), PAPER.start[1])), {}, Status.UNREACHABLE),
}


@pytest.mark.parametrize("case", FAILURES)
def test_failure_is_a_status_and_everything_stays_finite(program, case):
    parameters, horizon, status = FAILURES[case]
    run = program(parameters, **horizon)
    assert run.health.status == status
    assert all(np.isfinite(x).all() for x in jax.tree.leaves((run.state, run.signals)))

    failed_at = int(run.health.step)
    assert failed_at < len(run.t) - 1
    after = jax.tree.map(lambda x: x[failed_at:], run.signals.position)
    for frozen, last in zip(jax.tree.leaves(after), jax.tree.leaves(run.state.position), strict=True):
        assert np.all(frozen == last)


def test_new_numbers_compile_nothing(program):
    heavier = tuple(inertia._replace(m_p=7.0, m3=0.6) for inertia in PAPER.plant.inertia)
    other = PAPER._replace(
        plant=PAPER.plant._replace(inertia=heavier, gravity=9.8),
        gains=GAINS._replace(K_sigma=(0.7, 0.6, 0.5, 0.4, 0.3, 0.2), K_lambda=(1.0,) * 4, delta_floor=0.1),
        disturbance=(Disturbance(Sine(phase=0.3), scale=2.0),),
    )
    assert program(PAPER, steps=1).health.status == Status.OK
    traces = program.traces  # other tests of the session may have asked for other structures
    assert program(other, 2e-3, 50).health.status == Status.OK
    assert program.traces == traces
