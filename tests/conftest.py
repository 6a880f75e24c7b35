"""Strict numerics for every test, and one compilation cache outside the checkout."""

import functools
import gc
import os
from pathlib import Path

import jax
import pytest

import coopmm_jax
from coopmm_jax.kinds import plugins, registry
from coopmm_jax.parameters import Parameters, Structure
from tests.pictures import leave_pictures_blank, rendering
from tests.programs import Program
from tests.workers import compile_quickly

pytest_plugins = ["tests.sweeps"]

compile_quickly()
leave_pictures_blank()
_user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update(
    "jax_compilation_cache_dir",
    os.environ.get("JAX_COMPILATION_CACHE_DIR") or str(_user_cache / "coopmm_jax" / "tests"),
)
# JAX's own threshold of 1 s leaves out most of what these tests compile.
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)

# Files that take longest, first, so that two workers end together; the notebooks when the pages, whose programs most of
# them run, have been carried out.
_LONGEST = (
    *("pages", "sweep", "path_motion", "compare", "objective", "required", "gradients", "notebooks", "slopes"),
    *("lyapunov", "fuzz", "compliant_contact", "sampled_loop", "platforms", "tuning", "engine", "real_loop"),
)


def pytest_collection_modifyitems(items):
    rank = {f"test_{name}": i for i, name in enumerate(_LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish():
    """Leave nothing to pytest's ten collections at the end: each takes seconds over what JAX keeps."""
    gc.freeze()


@pytest.fixture
def rendered():
    """Pictures as users get them; others are blank."""
    with rendering():
        yield


@pytest.fixture(scope="session")
def programs():
    """structure -> its ``Program``, one for the whole session."""
    return functools.cache(Program)


@pytest.fixture(scope="session")
def short_programs():
    """As ``programs``, for 1000 steps at most."""
    return functools.cache(functools.partial(Program, room=1000))


@pytest.fixture(scope="session")
def paper_run(programs):
    """The paper's 20 s with the law as in the paper."""
    return programs(Structure())(Parameters())


@pytest.fixture(scope="session")
def simulated_paper():
    """``simulate`` on the first second of the paper's run."""
    return coopmm_jax.simulate(coopmm_jax.load_scenario("paper", simulation={"duration": 1.0}))


@pytest.fixture
def registered(monkeypatch):
    """A registry that forgets what the test registers."""
    monkeypatch.setattr(registry, "_KINDS", {group: dict(kinds) for group, kinds in registry._KINDS.items()})
    monkeypatch.setattr(plugins, "_loaded", {})
    monkeypatch.setattr(plugins, "_contents", {})
