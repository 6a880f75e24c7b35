"""Backstepping of chained forms of any length against the identities of the proof, figures, and n_v = 3 written out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.control import backstepping, chain
from coopmm_jax.control.chain import Chain
from coopmm_jax.control.reference import Desired
from coopmm_jax.loop.integrate import rk4_step
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.parameters import Gains

STATES = 100
LENGTHS = [3, 4, 5]


def chained_rates(zeta, u1, u2):
    """(8)."""
    return (u1, *(u1 * z for z in zeta[2:]), u2)


def identities(n, draw):
    """Left and right sides of (25)-(28) and of (32) along the flow at one random state, while u = z_b + utilde."""
    k0, t, eta, u_d2, *utilde = draw[:6]
    k, zeta, zeta_d = (tuple(draw[6 + i * n : 6 + (i + 1) * n]) for i in range(3))
    a, b, c, w = draw[-4:]

    def u_d1(t):  # every derivative different from zero, of both signs
        return a - 1.75 + (b - 1.75) * jnp.sin(w * t + 0.3) + (c - 1.75) * jnp.cos(0.7 * t)

    def at(t, zeta, zeta_d):
        return Chain(zeta, tuple(x - y for x, y in zip(zeta, zeta_d, strict=True)), derivatives(u_d1, t, n - 2), u_d2)

    now = at(t, zeta, zeta_d)
    u = [z + error for z, error in zip(chain.platform_velocity(k, now, eta), utilde, strict=True)]
    Lambda = chain.signal(k, now)
    eta_rate = -k0 * eta - Lambda[0]  # (15)
    rates = (1.0 + 0.0 * t, chained_rates(zeta, *u), chained_rates(zeta_d, now.u1[0], u_d2))

    def errors(*at_):
        return chain.errors(k, at(*at_))

    def V1(eta, *at_):
        return chain.stored(k, at(*at_)) + 0.5 * eta * eta

    s, s_rate = jax.jvp(errors, (t, zeta, zeta_d), rates)
    _, V1_rate = jax.jvp(V1, (eta, t, zeta, zeta_d), (eta_rate, *rates))
    W = (1.0 + 0.0 * t, *zeta[2:], 0.0 * t)  # L_g1 by a derivative of its own
    _, moved = jax.jvp(lambda e: chain.errors(k, now._replace(e=e)), (now.e,), (W,))
    ahead, first, power = eta + utilde[0], now.u1[0], now.u1[0] ** (2 * n - 4)
    right = [ahead, ahead * moved[1] + first * s[2] - k[1] * power * s[1]]
    right += [ahead * moved[j] + first * (s[j + 1] - s[j - 1]) - k[j] * power * s[j] for j in range(2, n - 1)]
    right += [ahead * moved[-1] - k[-1] * s[-1] - first * s[-2] + utilde[1]]
    terms = [*(k[j] * power * s[j] ** 2 for j in range(1, n - 1)), k[-1] * s[-1] ** 2, k0 * eta * eta]
    crossing = [error * part for error, part in zip(utilde, Lambda, strict=True)]
    through_eta = (-k0 * eta - k[0] * s[0] * moved[0] - sum(x * y for x, y in zip(s[1:], moved[1:], strict=True)),)
    return (
        (jnp.stack(s_rate), jnp.stack(right), jnp.abs(jnp.stack(right)).max()),
        (eta_rate, through_eta[0], jnp.maximum(1.0, abs(eta_rate))),
        (V1_rate, sum(crossing) - sum(terms), sum(map(abs, (*terms, *crossing, *(x * y for x, y in zip(s, s_rate)))))),
        (chain.decay(k, now) + k0 * eta * eta, sum(terms), sum(terms)),
    )


@pytest.mark.parametrize("n", LENGTHS)
def test_identities_of_the_proof(n):
    """(25)-(28) and (32), with u_d1^(2 l) where the paper prints u_d1^2."""
    draws = np.random.default_rng(n).uniform(0.5, 3.0, (STATES, 3 * n + 10))
    draws[:, 2:6] -= 1.75
    draws[:, 6 + n : 6 + 3 * n] -= 1.75
    compared = jax.jit(jax.vmap(lambda draw: identities(n, [draw[i] for i in range(3 * n + 10)])))(draws)
    for left, right, scale in compared:
        assert (np.abs(left - right).reshape(STATES, -1).max(axis=1) <= 1e-14 * scale).all()


def test_written_out_form_at_three_agrees():
    rng = np.random.default_rng(0)
    gains = Gains(k0=1.3, k1=2.0, k2=0.7, k3=1.1)
    for _ in range(20):
        z, z_d, (u1, u1_rate, u2, eta) = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3), rng.uniform(-1.5, 1.5, 4)
        position, desired = Position(*z, 0.0, 0.0, 0.0), Desired(*z_d, u1, u2, u1_rate, (), ())
        k, same = (2.0, 0.7, 1.1), Chain(tuple(z), tuple(z - z_d), (u1, u1_rate), u2)
        pairs = [
            (chain.errors(k, same), backstepping.backstepping_errors(gains, desired, position)[2:]),
            (chain.signal(k, same), backstepping.coupling_signal(gains, desired, position)),
            (
                chain.platform_velocity(k, same, eta),
                backstepping.reference_velocity(gains, desired, position, (), eta),
            ),
        ]
        for general, written in pairs:
            np.testing.assert_allclose(general, written, rtol=0, atol=5e-15)


@pytest.mark.parametrize(
    ("k", "zeta", "zeta_d", "u1", "expected"),
    [
        (
            (2, 0.7, 1.1, 0.9),
            (0.1, 0.5, 0.9, -0.3),
            (0.3, 0.2, -0.4, 0.6),
            (1.7, 0.6, -0.2),
            (2.05, -77.598390, 295.663925, 17.114798),
        ),
        (
            (2, 0.7, 1.1, 0.9, 0.8),
            (0.1, 0.5, 0.9, -0.3, 0.8),
            (0.3, 0.2, -0.4, 0.6, 0.1),
            (1.2, 0.6, -0.2, 0.4),
            (1.55, -250.940594, 1857.119483, 47.192563),
        ),
    ],
    ids=["4", "5"],
)
def test_law_at_one_state(k, zeta, zeta_d, u1, expected):
    """Figures of a derivation on matrices, s = A e."""
    now = Chain(zeta, tuple(a - b for a, b in zip(zeta, zeta_d, strict=True)), u1, 0.25)
    found = (*chain.platform_velocity(k, now, 0.35), *chain.signal(k, now))
    assert [float(x) for x in found] == pytest.approx(expected, abs=5e-7)


# u_d1 = mean + even cos t + odd sin t -> e(1 s) of a chain of 4 and of 5, as a derivation on matrices has it
WAYS = {
    (1.0, 0.0, 0.0): ((-0.007655, 0.121948, -0.086725, 0.004025), (-0.005103, 0.133539, -0.066140, -0.009208)),
    (1.0, 0.4, 0.0): ((-0.005177, 0.110163, -0.038406, 0.059927), None),
    (0.0, 0.0, 1.5): ((0.003877, 0.090850, -0.198398, 0.216498), None),
}
STEP, SECONDS = 2e-3, 20


def driven(n, way):
    """Errors (20, n) at whole seconds and V_1 at all steps of a chain that moves as its law asks."""
    k0, k = 5.0, (20.0,) + (1.0,) * (n - 1)
    mean, even, odd = way

    def rates(t, state):
        zeta, zeta_d, eta = state
        u1 = derivatives(lambda t: mean + even * jnp.cos(t) + odd * jnp.sin(t), t, n - 2)
        now = Chain(zeta, tuple(a - b for a, b in zip(zeta, zeta_d, strict=True)), u1, 0.0)
        u, (first, _) = chain.platform_velocity(k, now, eta), chain.signal(k, now)
        rate = (chained_rates(zeta, *u), chained_rates(zeta_d, u1[0], 0.0 * t), -k0 * eta - first)
        return rate, (now.e, chain.stored(k, now) + 0.5 * eta * eta)

    def step(state, i):
        state, (e, V1) = rk4_step(rates, i * STEP, STEP, state, None)
        return state, (jnp.stack(e), V1)

    e, zeta_d = (0.1, 0.2, -0.1, 0.1, -0.1)[:n], (0.0, 1.0) + (0.0,) * (n - 2)
    start = (tuple(map(jnp.asarray, np.add(e, zeta_d))), tuple(map(jnp.asarray, zeta_d)), jnp.asarray(0.0))
    _, (e, V1) = jax.lax.scan(step, start, jnp.arange(round(SECONDS / STEP) + 1, dtype=float))
    return e[:: round(1 / STEP)], V1


@pytest.mark.parametrize("n", [4, 5])
def test_errors_vanish_whichever_way_the_platform_turns(n):
    ways = np.array(list(WAYS))
    e, V1 = jax.jit(jax.vmap(lambda way: driven(n, way)))(ways)
    for i, figures in enumerate(WAYS.values()):
        if figures[n - 4] is not None:
            np.testing.assert_allclose(e[i, 1, :4], figures[n - 4], rtol=0, atol=1e-6)
    assert (np.abs(e[:, -1]).max(axis=1) < 4e-8).all()
    assert (np.diff(V1, axis=1) <= 1e-15).all()
