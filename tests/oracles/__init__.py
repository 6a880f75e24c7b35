"""Second derivations of the dynamics, which share nothing with coopmm_jax but the parameters."""
