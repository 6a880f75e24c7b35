"""Two cooperating mobile manipulators under robust adaptive force and motion control, in JAX.

    import coopmm_jax as cm

    trajectory = cm.simulate(cm.load_scenario("paper"))

Importing the package sets one XLA option (see ``runtime.use_small_while_loops``) and does not import JAX.
"""

from __future__ import annotations

from coopmm_jax import runtime

__version__ = "0.1.0"

runtime.use_small_while_loops()
