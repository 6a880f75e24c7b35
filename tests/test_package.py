"""The names a notebook uses."""

import ast
import pkgutil
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

import coopmm_jax
import tuning


def test_public_names_are_what_they_say():
    assert all(callable(getattr(coopmm_jax, name)) for name in coopmm_jax.__all__)
    assert dir(coopmm_jax) == sorted([*coopmm_jax.__all__, "__version__"])


@pytest.mark.parametrize("package", [coopmm_jax, tuning])
def test_editors_are_told_the_names_that_are_fetched_when_used(package):
    """The imports for type checkers alone are those that ``__getattr__`` makes."""
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    told = {alias.asname or alias.name: (node.module, alias.name) for node in block.body for alias in node.names}
    assert sorted(told) == package.__all__
    assert {name: getattr(package, name) for name in told} == {
        name: getattr(import_module(module), there) for name, (module, there) in told.items()
    }


def test_importing_the_package_imports_neither_jax_nor_the_tuner():
    """The studies among its names come from the package tuning, which builds on this one."""
    heavy = "{'jax', 'tuning', 'numpy', 'xarray', 'matplotlib'}"
    code = f"import sys, coopmm_jax as cm; assert 'tune' in dir(cm); print({heavy} & set(sys.modules))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "set()\n"


def test_no_module_takes_a_functions_name():
    modules = {module.name for module in pkgutil.iter_modules(coopmm_jax.__path__)}
    assert modules & set(coopmm_jax.__all__) == set()


def test_unknown_name():
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = coopmm_jax.simulat


def test_version_is_the_installed_one():
    assert coopmm_jax.__version__ == version("coopmm_jax")
