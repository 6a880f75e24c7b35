"""The subcommands of ``coopmm``, one module each: ``add`` declares its arguments, ``run`` does it.

A module's parser sets three defaults: ``run``; ``takes_overrides``, whether --section.field may be given; ``computes``,
whether it runs rollouts, for which XLA's options are worth setting. A fourth, ``sweeps``, says that most of its time
goes into large batches, without gradients.
"""

DONE, BAD_INPUT, ROLLOUT_FAILED, INTERRUPTED = 0, 2, 3, 130  # exit codes
