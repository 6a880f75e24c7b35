"""Trial of a controller: the methods of its protocol, traced once on shapes alone, before anything is compiled."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import PyTree, Scalar
from coopmm_jax.control.controller import Command, Freedom, Seen, entries_of, known_to_controller
from coopmm_jax.control.force import ForceFeedback
from coopmm_jax.control.gain_schedule import in_force
from coopmm_jax.control.reference import at_instant
from coopmm_jax.control.standing import standing_start
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import signals_of
from coopmm_jax.kinds.registry import kind_of
from coopmm_jax.mechanics.constrained_kinematics import kinematics
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import Parameters, Structure

_TRIALS = 64  # that are remembered: a scenario is made hundreds of times while it is loaded, varied and swept


def try_controller(structure: Structure, parameters: Parameters) -> None:
    """Trace every method of a controller at one instant, and check the shapes of its answers.

    Args:
        structure: static choices.
        parameters: of the rollout, with the gains; their numbers play no part.

    Raises:
        UserError: a method that raises, or whose answer has another form than the protocol asks for.
    """
    leaves, tree = jax.tree.flatten(parameters)
    _try(type(parameters.gains), structure, tree, tuple(jnp.shape(leaf) for leaf in leaves))


@functools.lru_cache(maxsize=_TRIALS)
def _try(made: type, structure: Structure, tree: Any, shapes: tuple[tuple[int, ...], ...]) -> None:
    kind = kind_of(made)
    assert kind is not None
    with jax.enable_x64(True):
        *leaves, t = (jax.ShapeDtypeStruct(shape, jnp.float64) for shape in (*shapes, ()))
        jax.eval_shape(_Trial(kind.label, structure).run, jax.tree.unflatten(tree, leaves), t)


class _Trial(NamedTuple):
    label: str  # of the controller
    structure: Structure

    def run(self, parameters: Parameters, t: Scalar) -> None:
        """Ask a controller everything that a loop asks, at t [s]."""
        model, freedom = build_model(parameters), Freedom.of(self.structure)
        model = model._replace(reference=at_instant(model.reference, t), gains=in_force(model, t))
        gains, independent, error = model.gains, (t,) * freedom.velocities, (t,) * freedom.rows
        state = self.state(self.calling("start", gains.start, freedom, t))
        k = kinematics(model, self.structure.rows, standing_start(model, parameters, t), independent)
        seen = Seen(self.structure, known_to_controller(model), t, k, independent)
        command = self.calling("command", gains.command, seen, state)
        self.check_command(command)
        self.check_signals(gains, state, command.signals, freedom)
        self.check_rates(state, self.calling("command: rates", command.rates, error))
        self.check_feedback(self.calling("force_feedback", gains.force_feedback, state), freedom.rows)
        if hasattr(gains, "estimates"):
            estimates = self.calling("estimates", gains.estimates, state)
            self.must(_is_vector(estimates), "estimates", "a tuple of numbers", estimates)

    def state(self, started: PyTree) -> PyTree:
        """State at the start, with leaves as the loop carries them."""
        sound = all(map(_is_number, jax.tree.leaves(started)))
        self.must(sound, "start", "a pytree of numbers, its state", started)
        return jax.tree.map(lambda x: jnp.asarray(x, jnp.result_type(float)), started)

    def check_command(self, command: Any) -> None:
        self.must(isinstance(command, Command), "command", "a Command(force, rates, signals)", command)
        force = command.force
        joints = self.structure.joints
        sound = isinstance(force, tuple) and len(force) == 2 and all(map(_is_vector, force, joints))
        counts = " and ".join(map(str, dict.fromkeys(joints)))
        self.must(sound, "command: force", f"a pair of tuples of {counts} numbers, F on all joints", force)
        self.must(callable(command.rates), "command: rates", "a function of the force error", command.rates)
        self.must(isinstance(command.signals, Mapping), "command: signals", "a dict by name", command.signals)

    def check_signals(self, gains: Any, state: PyTree, computed: Mapping[str, Any], freedom: Freedom) -> None:
        for name, signal in signals_of(gains).items():
            place, count = f"signals: {name}", entries_of(signal, freedom)
            if name not in computed and not hasattr(state, name):
                must = "among the signals of the command, or a field of the state"
                raise UserError(f"{self.label}: {place}", must, "neither")
            value = computed[name] if name in computed else getattr(state, name)
            sound = _is_number(value) if count is None else _is_vector(value, count)
            self.must(sound, place, "a number" if count is None else f"a tuple of {count} numbers", value)

    def check_rates(self, state: PyTree, rates: PyTree) -> None:
        same = jax.tree.structure(rates) == jax.tree.structure(state)
        sound = same and all(map(_is_number, jax.tree.leaves(rates)))
        self.must(sound, "command: rates", f"of the form of its state, {_form(state)}", rates)

    def check_feedback(self, feedback: Any, rows: int) -> None:
        sound = isinstance(feedback, ForceFeedback) and all(_is_vector(part, rows) for part in feedback)
        self.must(sound, "force_feedback", f"a ForceFeedback of two tuples of {rows} numbers", feedback)

    def calling(self, method: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Answer of a method.

        Raises:
            UserError: it raises.
        """
        try:
            return function(*arguments)
        except UserError:
            raise
        except Exception as error:
            raise UserError(f"{self.label}: {method}", "free of errors", f"{type(error).__name__}: {error}") from None

    def must(self, sound: bool, method: str, form: str, answer: Any) -> None:
        """Refuse an answer that is not sound.

        Raises:
            UserError: it is not.
        """
        if not sound:
            raise UserError(f"{self.label}: {method}", form, _form(answer))


def _has_shape(value: Any) -> bool:
    return isinstance(value, int | float) or hasattr(value, "shape")


def _is_number(value: Any) -> bool:
    return _has_shape(value) and jnp.shape(value) == ()


def _is_vector(value: Any, count: int | None = None) -> bool:
    return isinstance(value, tuple) and all(map(_is_number, value)) and (count is None or len(value) == count)


class _Word(str):
    """Text that prints without quotation marks."""

    __repr__ = str.__str__


def _form(answer: Any) -> str:
    """Text of an answer in which a word stands for each number or array."""

    def leaf(value: Any) -> _Word:
        if not _has_shape(value):
            return _Word(type(value).__name__)
        return _Word("number" if _is_number(value) else f"array{jnp.shape(value)}")

    return str(jax.tree.map(leaf, answer))
