"""The loop in JAX against the same equations in C: one rollout, and a batch against explicit AVX-512 vectors.

    python -m experiments.benchmarks.in_c [--rounds 15]

The vector field of ``paper`` is translated from its jaxpr, with common subexpressions once and without what nothing
reads, and C++ runs the classical Runge-Kutta method around it, eight rollouts to a register in a batch. JAX judges all
steps, C none. Times are CPU seconds of one core, in turn, so that a busy machine slows all of them; it slows JAX more,
whose loops talk through the cache. Needs g++ and a processor with AVX-512.
"""

from __future__ import annotations

import argparse
import ctypes
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.interpreters import partial_eval

from coopmm_jax import load_scenario, runtime
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.rollout import Plan, as_scalars, rollout
from coopmm_jax.loop.start import initial_state
from coopmm_jax.mechanics.model import build_model

STEP = 1e-3
ALONE, BATCHED = 4000, 400  # steps of one rollout and of a batch
ELEMENTS, LANES = 64, 8  # rollouts of a batch, and of a register
BINARY = {"add": "+", "add_any": "+", "sub": "-", "mul": "*", "div": "/"}
COMPARED = {"lt": "<", "gt": ">", "ge": ">=", "le": "<=", "eq": "==", "and": "&", "or": "|"}
CHOSEN = {"max": ">", "min": "<"}
CALLED = ("sqrt", "floor", "round", "abs")
SAME = ("convert_element_type", "copy", "optimization_barrier")
HEAD = """
#include <immintrin.h>
#include <cmath>
#ifdef SCALAR
typedef double V; typedef bool M;
static inline V C(double c) { return c; }
static inline V c_sqrt(V a) { return std::sqrt(a); }
static inline V c_floor(V a) { return std::floor(a); }
static inline V c_round(V a) { return std::nearbyint(a); }
static inline V c_abs(V a) { return std::fabs(a); }
#else
typedef double V __attribute__((vector_size(64))); typedef long long M __attribute__((vector_size(64)));
static inline V C(double c) { return (V)_mm512_set1_pd(c); }
static inline V c_sqrt(V a) { return (V)_mm512_sqrt_pd((__m512d)a); }
static inline V c_floor(V a) { return (V)_mm512_roundscale_pd((__m512d)a, 9); }
static inline V c_round(V a) { return (V)_mm512_roundscale_pd((__m512d)a, 8); }
static inline V c_abs(V a) { return (V)_mm512_abs_pd((__m512d)a); }
#endif
"""
RUN = """
static __attribute__((noinline))
void field(const V* __restrict p, V t, const V* __restrict x, V* __restrict r) { %(body)s }
extern "C" void run(const V* p, V* x, double h, long steps, long groups) {
  const int n = %(states)d, m = %(numbers)d;
  for (long g = 0; g < groups; g++, p += m, x += n) {
    V k[n], y[n], a[n];
    for (long i = 0; i < steps; i++) {
      double t = i * h;
      field(p, C(t), x, k);         for (int j = 0; j < n; j++) { a[j] = k[j]; y[j] = x[j] + C(h / 2) * k[j]; }
      field(p, C(t + h / 2), y, k); for (int j = 0; j < n; j++) { a[j] += C(2) * k[j]; y[j] = x[j] + C(h / 2) * k[j]; }
      field(p, C(t + h / 2), y, k); for (int j = 0; j < n; j++) { a[j] += C(2) * k[j]; y[j] = x[j] + C(h) * k[j]; }
      field(p, C(t + h), y, k);     for (int j = 0; j < n; j++) x[j] += C(h / 6) * (a[j] + k[j]);
    }
  }
}
"""


class Translation:
    """Lines of C for a jaxpr of scalars, each expression once."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, str] = {}

    def of(self, jaxpr: Any, constants: Sequence[Any], arguments: Sequence[str]) -> list[str]:
        """Names of the results."""
        known = dict(zip(jaxpr.constvars, map(_literal, constants), strict=True))
        known |= dict(zip(jaxpr.invars, arguments, strict=True))

        def read(atom: Any) -> str:
            return _literal(atom.val) if hasattr(atom, "val") else known[atom]

        for equation in jaxpr.eqns:
            known |= zip(equation.outvars, self._equation(equation, list(map(read, equation.invars))), strict=True)
        return list(map(read, jaxpr.outvars))

    def _equation(self, equation: Any, a: list[str]) -> list[str]:
        name, inner = equation.primitive.name, equation.params.get("jaxpr") or equation.params.get("call_jaxpr")
        if inner is not None:
            return self.of(inner.jaxpr, inner.consts, a)
        if name in SAME:
            return a
        if name in COMPARED:
            return [self._line(f"{a[0]} {COMPARED[name]} {a[1]}", "M")]
        return [self._line(self._expression(equation, name, a), "V")]

    def _expression(self, equation: Any, name: str, a: list[str]) -> str:
        if name in BINARY:
            return f"{a[0]} {BINARY[name]} {a[1]}"
        if name in CHOSEN:
            return f"{a[0]} {CHOSEN[name]} {a[1]} ? {a[0]} : {a[1]}"
        if name in CALLED:
            return f"c_{name}({a[0]})"
        if name == "neg":
            return f"-{a[0]}"
        if name == "select_n":
            return f"{a[0]} ? {a[2]} : {a[1]}"
        if name in ("square", "integer_pow"):
            power = equation.params.get("y", 2)
            product = " * ".join([a[0]] * abs(power))
            return product if power > 0 else f"C(1) / ({product})"
        raise NotImplementedError(f"{name} in C")

    def _line(self, expression: str, kind: str) -> str:
        if expression not in self.names:
            self.names[expression] = f"v{len(self.names)}"
            self.lines.append(f"const {kind} {self.names[expression]} = {expression};")
        return self.names[expression]


def _literal(value: Any) -> str:
    return f"C({float(value)!r})"


def translated(structure: Any, model: Any, state: Any) -> tuple[str, int]:
    """C++ of the loop, and the number of operations of a stage."""
    (numbers, of_model), (start, of_state) = jax.tree.flatten(model), jax.tree.flatten(state)

    def field(numbers: list, t: Any, x: list) -> list:
        rates, _ = closed_loop(structure, jax.tree.unflatten(of_model, numbers), t, jax.tree.unflatten(of_state, x))
        return jax.tree.leaves(rates)

    closed = jax.make_jaxpr(field)(numbers, jnp.zeros(()), start)
    jaxpr, read = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(start))
    names = [*(f"p[{i}]" for i in range(len(numbers))), "t", *(f"x[{i}]" for i in range(len(start)))]
    lines = Translation()
    rates = lines.of(jaxpr, closed.consts, [name for name, used in zip(names, read, strict=True) if used])
    body = "\n".join([*lines.lines, *(f"r[{i}] = {rate};" for i, rate in enumerate(rates))])
    return HEAD + RUN % {"body": body, "states": len(start), "numbers": len(numbers)}, len(lines.lines)


def compiled(code: str, folder: Path, lanes: int) -> Callable:
    """Function ``run`` of the C++, for one rollout or for so many in a register."""
    source, library = folder / "loop.cpp", folder / f"loop_{lanes}.so"
    source.write_text(code)
    flags = ["-DSCALAR"] if lanes == 1 else []
    subprocess.run(["g++", "-O3", "-march=native", "-shared", "-fPIC", *flags, "-o", library, source], check=True)
    return ctypes.CDLL(str(library)).run


def in_c(run: Callable, model: Any, state: Any, steps: int, elements: int, lanes: int) -> Callable[[], np.ndarray]:
    """Function that runs so many equal rollouts and returns the last state of the first (S,)."""
    numbers, start = (np.array([float(x) for x in jax.tree.leaves(tree)]) for tree in (model, state))
    groups = elements // lanes
    p, x = _aligned(groups, len(numbers), lanes), _aligned(groups, len(start), lanes)
    p[:] = numbers[:, None]

    def go() -> np.ndarray:
        x[:] = start[:, None]
        places = (ctypes.c_void_p(array.ctypes.data) for array in (p, x))
        run(*places, ctypes.c_double(STEP), ctypes.c_long(steps), ctypes.c_long(groups))
        return x[0, :, 0].copy()

    return go


def _aligned(*shape: int) -> np.ndarray:
    """Zeros that begin at a multiple of 64 bytes."""
    count = int(np.prod(shape))
    room = np.zeros(count + LANES)
    first = (-room.ctypes.data // room.itemsize) % LANES
    return room[first : first + count].reshape(shape)


def in_jax(structure: Any, parameters: Any, steps: int, elements: int) -> Callable[[], Any]:
    """Function that runs as many rollouts in JAX and returns their last states."""
    plan = Plan.alone(steps) if elements == 1 else Plan.batch(steps)

    def final(parameters: Any) -> Any:
        return rollout(structure, parameters, STEP, steps, plan).state

    many = parameters if elements == 1 else jax.tree.map(lambda x: jnp.broadcast_to(x, elements), parameters)
    program = jax.jit(final if elements == 1 else jax.vmap(final)).lower(many).compile()
    return lambda: jax.block_until_ready(program(many))


def main(argv: Sequence[str] | None = None) -> int:
    """Translate, compile and time; print the ratios."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    options = parser.parse_args(argv)
    runtime.use_fast_compilation(batches=True)
    jax.config.update("jax_enable_x64", True)
    scenario = load_scenario("paper")
    structure, parameters = scenario.structure(), as_scalars(scenario.parameters(), jnp.float64)
    model = build_model(parameters)
    state = initial_state(structure, model, parameters).state
    code, operations = translated(structure, model, state)
    with tempfile.TemporaryDirectory() as folder:
        scalar, vector = (compiled(code, Path(folder), lanes) for lanes in (1, LANES))
    runs = {
        "one rollout, C": (in_c(scalar, model, state, ALONE, 1, 1), ALONE),
        "one rollout, JAX": (in_jax(structure, parameters, ALONE, 1), ALONE),
        "batch, C": (in_c(vector, model, state, BATCHED, ELEMENTS, LANES), BATCHED * ELEMENTS),
        "batch, JAX": (in_jax(structure, parameters, BATCHED, ELEMENTS), BATCHED * ELEMENTS),
    }
    ours, c = runs["batch, JAX"][0](), runs["batch, C"][0]()
    difference = np.abs([np.ravel(x)[0] for x in jax.tree.leaves(ours)] - c).max()
    print(f"{operations} operations of a stage; states after {BATCHED} steps differ by {difference:.0e} at most")
    speeds = _measured(runs, options.rounds)
    for name, speed in speeds.items():
        print(f"{name:18} {speed / 1e6:6.3f} M steps per second of CPU")
    for kind in ("one rollout", "batch"):
        print(f"{kind}: JAX at {speeds[f'{kind}, JAX'] / speeds[f'{kind}, C']:.2f} of C")
    return 0


def _measured(runs: dict[str, tuple[Callable, int]], rounds: int) -> dict[str, float]:
    """Median steps per CPU second of each."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, (go, _) in runs.items():
            began = time.process_time()
            go()
            seconds[name].append(time.process_time() - began)
    return {name: runs[name][1] / statistics.median(taken) for name, taken in seconds.items()}


if __name__ == "__main__":
    sys.exit(main())
