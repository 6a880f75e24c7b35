"""The names a notebook uses."""

import pkgutil
from importlib.metadata import version

import pytest

import coopmm_jax


def test_public_names_are_what_they_say():
    assert all(callable(getattr(coopmm_jax, name)) for name in coopmm_jax.__all__)
    assert set(coopmm_jax.__all__) <= set(dir(coopmm_jax))


def test_no_module_takes_a_functions_name():
    modules = {module.name for module in pkgutil.iter_modules(coopmm_jax.__path__)}
    assert modules & set(coopmm_jax.__all__) == set()


def test_unknown_name():
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = coopmm_jax.simulat


def test_version_is_the_installed_one():
    assert coopmm_jax.__version__ == version("coopmm_jax")
