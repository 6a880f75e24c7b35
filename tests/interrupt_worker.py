"""The command line around a computation that XLA does not come back from."""

import signal
import sys

import jax

import coopmm_jax
from coopmm_jax import cli


def endless(scenario):
    """Compute in XLA for hours, where Python's own handlers of signals have to wait."""
    compute = jax.jit(lambda x: jax.lax.while_loop(lambda x: x < 2.0, lambda x: x * 0.5, x)).lower(1.0).compile()
    print("computing", flush=True)
    return compute(1.0).block_until_ready()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests were begun in the background
    coopmm_jax.simulate = endless
    sys.exit(cli.main())
