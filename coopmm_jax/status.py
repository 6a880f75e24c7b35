"""Outcome of a rollout: failure is data, one code per rollout, so that no NaN spreads through a batch or gradient."""

from __future__ import annotations

import enum

# Limits that no working loop comes near, reached long before anything overflows, so that the values handed to the next
# step, and their gradients, are still finite.
SPEED_LIMIT = 1e3  # [rad/s, m/s]
CONTROLLER_LIMIT = 1e6  # of the controller's states
# Fraction of the starting determinant of J_dep's blocks below which an arm counts as singular.
SINGULAR_FRACTION = 1e-2


class Status(enum.IntEnum):
    """Outcome of a rollout; everything but ``OK`` stops it at the last good state."""

    OK = 0
    SPEED = 1
    CONTROLLER = 2
    SINGULAR_CONTACT = 3
    SINGULAR_GUIDE = 4
    UNREACHABLE = 5
    TOO_LONG = 6

    @property
    def message(self) -> str:
        """One line for a person, naming the quantity."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OK: "completed",
    Status.SPEED: f"a velocity u left +-{SPEED_LIMIT:g} (rad/s, m/s) or is not finite",
    Status.CONTROLLER: f"a state of the controller, as an integral, left +-{CONTROLLER_LIMIT:g} or is not finite",
    Status.SINGULAR_CONTACT: "arm of robot I became singular for its contact rows (determinant of J_dep)",
    Status.SINGULAR_GUIDE: "arm of robot II became singular for its guide rows (determinant of J_dep)",
    Status.UNREACHABLE: "no start configuration meets the constraint rows: an arm cannot reach its contact or guide",
    Status.TOO_LONG: "more steps were asked for than the compiled rollout has room for",
}
