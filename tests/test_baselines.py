"""The controllers that the paper's is compared with: a second derivation, closed forms, slopes, both loops."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.control.controller import Freedom, Seen, known_to_controller, recorded
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.baselines import ComputedTorque, ModelBased, Pid, RobustFixed, SlidingMode
from coopmm_jax.kinds.controllers import gains_of, lateral, name_of, signals_of
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.form import Scalars
from coopmm_jax.loop.sampled_loop import sampled_step
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics.constrained_kinematics import kinematics
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import ALL_ROWS, Structure
from coopmm_jax.proof.lyapunov import analyse
from coopmm_jax.scenario.scenario import load_scenario
from tests.oracles import baselines
from tests.samples import assert_close, joined, vector
from tests.test_control import Case, T

BASELINES = (ModelBased, RobustFixed, SlidingMode, ComputedTorque, Pid)
LAWS = (Structure(), Structure(feedforward="full"))
FREEDOM = Freedom.of(Structure())


def random_gains(made, rng):
    """Gains of a controller that all differ from each other."""
    drawn = {}
    for name, about in gains_of(made).items():
        count = about.entries(FREEDOM.velocities, FREEDOM.rows)
        drawn[name] = rng.uniform(0.3, 2.0) if count is None else tuple(rng.uniform(0.3, 2.0, count).tolist())
    return made(**drawn)


class BaselineCase(Case):
    """The closed loop of ``test_control.py`` at a random state, under another controller."""

    def __init__(self, made, seed=0):
        super().__init__(seed)
        rng = np.random.default_rng(seed)
        self.parameters = self.parameters._replace(gains=random_gains(made, rng))
        self.model = build_model(self.parameters)
        zero = self.model.gains.start(FREEDOM, 0.0)
        leaves, tree = jax.tree.flatten(zero)
        self.own = jax.tree.unflatten(tree, rng.uniform(0.2, 1.0, len(leaves)).tolist())
        self.state = State(self.state.position, self.independent, self.own)

    def exact(self):
        """The model of a controller that knows the plant, which nothing disturbs."""
        return build_model(self.parameters._replace(nominal=self.parameters.plant.inertia, disturbance=()))


@pytest.fixture(scope="module", params=BASELINES, ids=lambda made: made.__name__)
def case(request):
    return BaselineCase(request.param)


@pytest.mark.parametrize("law", LAWS, ids=["projected", "full"])
def test_force_is_that_of_a_second_derivation(case, law):
    k = kinematics(case.model, ALL_ROWS, case.state.position, case.independent)
    seen = Seen(law, known_to_controller(case.model), T, k, case.independent)
    command = case.model.gains.command(seen, case.own)
    derived = getattr(baselines, name_of(case.model.gains))
    assert_close(joined(command.force), derived(law, case.parameters, T, case.q, case.u, case.own), 5e-14)
    rates = command.rates((1.0, 2.0, 3.0, 4.0))
    assert rates.force_integral == (1.0, 2.0, 3.0, 4.0)
    assert jax.tree.structure(rates) == jax.tree.structure(case.own)
    assert set(recorded(case.model.gains, case.own, command.signals)) == set(signals_of(case.model.gains))


def along_the_flow(case, signal):
    """A signal under an exact model without disturbances, its rate along the flow, and all signals."""
    model = case.exact()
    flow, signals = closed_loop(LAWS[1], model, T, case.state)
    value, rate = jax.jvp(
        lambda t, state: closed_loop(LAWS[1], model, t, state)[1].computed[signal], (T, case.state), (1.0, flow)
    )
    return vector(value), vector(rate), {name: vector(x) for name, x in signals.computed.items()}


def test_sigma_decays_where_the_model_is_exact():
    case = BaselineCase(ModelBased)
    sigma, rate, _ = along_the_flow(case, "sigma")
    assert_close(rate, -np.array(case.parameters.gains.K_sigma) * sigma, 1e-13)


def test_sigma_reaches_its_layer_at_the_rate_of_the_reaching_law():
    case = BaselineCase(SlidingMode)
    gains = case.parameters.gains
    sigma, rate, _ = along_the_flow(case, "sigma")
    reaching = np.array(gains.K_sigma) * sigma + np.array(gains.K_switch) * np.tanh(sigma / gains.layer)
    assert_close(rate, -reaching, 1e-13)


def test_joint_errors_obey_a_pd_where_the_model_is_exact():
    case = BaselineCase(ComputedTorque)
    gains = case.parameters.gains
    velocity, rate, computed = along_the_flow(case, "velocity_error")
    position = computed["position_error"]
    assert_close(rate, -np.array(gains.K_d) * velocity - np.array(gains.K_p) * position, 1e-13)


# Relative, of differences of the fourth order, whose truncation and rounding are both near 1e-11.
SHIFTS = (2e-3, 1e-3, -1e-3, -2e-3)
MOST_GAINS = 32


def test_slopes_of_the_loop_by_every_gain_are_those_of_differences(case):
    """Accelerations, the state's rates and constraint forces at one instant, which a rollout is made of."""
    leaves, tree = jax.tree.flatten(case.parameters.gains)
    count = len(leaves)

    def loop(values):
        model = case.model._replace(gains=jax.tree.unflatten(tree, values))
        rates, signals = closed_loop(LAWS[1], model, T, case.state)
        return jnp.stack([*rates.velocity, *jax.tree.leaves(rates.controller), *signals.constraint_force])

    # One batch for slopes and shifted values, of one size for all controllers, so that it compiles once.
    directions = np.zeros((1 + len(SHIFTS), MOST_GAINS, count))
    directions[:, :count] = np.diag(leaves)
    points = np.array(leaves) + np.array([0.0, *SHIFTS])[:, None, None] * directions
    batch = (list(x.reshape(-1, count).T) for x in (points, directions))
    found = jax.vmap(lambda x, along: jax.jvp(loop, (x,), (along,)))(*batch)
    values, slopes = (np.array(x).reshape(1 + len(SHIFTS), MOST_GAINS, -1)[:, :count] for x in found)
    differences = np.tensordot([-1.0, 8.0, -8.0, 1.0], values[1:], 1) / (6.0 * SHIFTS[0])
    np.testing.assert_allclose(slopes[0], differences, rtol=1e-9, atol=1e-9 * np.abs(slopes[0]).max())
    names = [name for name, value in case.parameters.gains._asdict().items() for _ in jax.tree.leaves(value)]
    idle = {name for name, slope in zip(names, slopes[0], strict=True) if not slope.any()}
    assert idle == {"k4"} & set(names)  # which platforms on two axles have a use for


def test_sampled_loop_moves_the_state_by_one_step_of_its_rates(case):
    law, period = LAWS[1]._replace(substeps=1), 1e-3
    (rates, signals), (after, sampled) = (
        closed_loop(LAWS[1], case.model, T, case.state),
        sampled_step(law, Scalars(), case.model, 0, T, period, case.state),
    )
    before = vector(jax.tree.leaves(case.own))
    expected = before + period * vector(jax.tree.leaves(rates.controller))
    assert_close(vector(jax.tree.leaves(after.controller)), expected, 1e-14)
    assert_close(joined(sampled.torque), joined(signals.torque), 1e-14)


def test_proof_is_about_the_papers_controller_alone():
    run = SimpleNamespace(scenario=load_scenario("paper", law={"controller": "pid"}))
    with pytest.raises(
        UserError, match=r"^law.controller: must be robust_adaptive, which the proof is about, was pid$"
    ):
        analyse(run)


def test_lateral_errors_decay_by_the_gain_that_a_controller_names():
    assert [lateral(made(k2=0.25)) for made in BASELINES] == [0.25] * 5
    assert lateral(()) == 0.0
