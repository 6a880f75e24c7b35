"""From a TOML file to the parameters of a rollout, and to the samples of its uncertainty; nothing here imports JAX."""
