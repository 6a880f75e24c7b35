"""Software that a result's digits depend on: versions of packages, and plugins by their content.

>>> sorted(versions())[:3]
['coopmm_jax', 'jax', 'jaxlib']
"""

from __future__ import annotations

import functools
import platform
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from coopmm_jax.errors import UserError
from coopmm_jax.kinds import plugins

_PLUGIN = "plugin "  # before the name of one


def versions() -> dict[str, str]:
    """Versions of Python, of this code, of the packages that decide a result's digits, and of plugins."""
    from coopmm_jax import __version__  # of the code that runs, whatever is installed

    packages = ("jax", "jaxlib", "numpy")
    own = {"python": platform.python_version(), "coopmm_jax": __version__}
    loaded = {f"{_PLUGIN}{plugin.name}": plugin.version for plugin in plugins.loaded()}
    return own | {package: _installed(package) for package in packages} | loaded


_installed = functools.cache(version)  # reads the package's files each time


def record(software: Mapping[str, Any]) -> str:
    """Lines of a comment that say what a file was made with."""
    return "".join(f"# {name} {value}\n" for name, value in software.items())


def recorded_plugins(text: str) -> dict[str, str]:
    """Plugins among the lines of ``record`` in a text.

    >>> recorded_plugins("# jax 0.10.2\\n# plugin bump 5f2c\\n")
    {'plugin bump': '5f2c'}
    """
    lines = (line.removeprefix("# ") for line in text.splitlines() if line.startswith(f"# {_PLUGIN}"))
    return dict(line.rsplit(" ", 1) for line in lines)


def loaded_plugins() -> dict[str, str]:
    """Versions of the plugins alone."""
    return {name: version for name, version in versions().items() if name.startswith(_PLUGIN)}


def check_plugins(recorded: Mapping[str, Any], field: str, what: Any) -> None:
    """Refuse what was made with plugins that are not loaded, or not with the same content.

    Args:
        recorded: ``versions`` of that time.
        field: where the user named what was made.
        what: was made, for the error.

    Raises:
        UserError: a plugin is missing, or another one of its name is loaded.
    """
    now = versions()
    for name, was in recorded.items():
        if name.startswith(_PLUGIN) and now.get(name) != was:
            option = f"{plugins.OPTION} {name.removeprefix(_PLUGIN)}"
            state = f"another ({now[name]})" if name in now else "used without"
            raise UserError(field, f"used with the {option} that {what} was made with ({was})", state)
