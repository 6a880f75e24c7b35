"""Plugins: Python files and entry points that register kinds.

A plugin is code that the user names, on the command line by ``--plugin FILE`` or in Python by ``load_plugin``, or a
package that the user has installed. A scenario file names kinds, and never runs code.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import sys
import traceback
from collections.abc import Iterable
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import CodeType
from typing import NamedTuple

import coopmm_jax
from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path
from coopmm_jax.kinds.registry import registering

ENTRY_POINTS = "coopmm_jax.plugins"  # the group in which a package declares modules that register kinds
OPTION = "--plugin"
_DIGITS = 16  # of a SHA-256, enough to tell files apart


class Plugin(NamedTuple):
    """A plugin that has been loaded."""

    name: str  # of its file, without folder, or of its entry point
    version: str  # of the package, or the beginning of the SHA-256 of the file's bytes


class Source(NamedTuple):
    """A plugin's file, to be loaded in another process."""

    path: str
    content: bytes


_loaded: dict[str, Plugin] = {}  # by resolved path, or by name of the entry point
_contents: dict[str, bytes] = {}  # of files, by the same path


def load_plugin(path: str | Path, option: str = OPTION) -> None:
    """Run a Python file that registers kinds; a file that has been loaded already is not run again.

    Args:
        path: of the file.
        option: what the user knows the path as, for the error.

    Raises:
        UserError: no such file, one that cannot be run, or one that registers what cannot be used; nothing of it stays.
    """
    file = resolve_path(path, option)
    try:
        content = file.read_bytes()
    except OSError as error:
        raise UserError(option, "a Python file", f"{path} ({error.strerror})") from None
    _load(file.resolve(), content, path, option)


def sources() -> tuple[Source, ...]:
    """Files that have been loaded, in their order."""
    return tuple(Source(path, content) for path, content in _contents.items())


def load_sources(files: Iterable[Source]) -> None:
    """Load files that another process has loaded, whether or not they exist here.

    Raises:
        UserError: as ``load_plugin``.
    """
    for path, content in files:
        _load(Path(path), content, path, OPTION)


def _load(file: Path, content: bytes, path: str | Path, option: str) -> None:
    key, plugin = str(file), Plugin(file.name, hashlib.sha256(content).hexdigest()[:_DIGITS])
    if key in _loaded:
        if _loaded[key] != plugin:
            raise UserError(option, "a file that does not change while this process runs", path)
        return
    if any(other.name == plugin.name for other in _loaded.values()):
        raise UserError(option, "files of different names", path)
    _run(file, content, option)
    _loaded[key], _contents[key] = plugin, content


def load_installed() -> None:
    """Import the modules that installed packages declare as plugins.

    Raises:
        UserError: a module that cannot be imported, or that registers what cannot be used.
    """
    for point in _installed():
        if point.name in _loaded:
            continue
        _register_built_in()
        with registering(point.name):
            try:
                point.load()
            except UserError:
                raise
            except Exception as error:
                raise UserError(f"plugin {point.name}", f"importable ({point.value})", _told(error, None)) from None
        version = point.dist.version if point.dist is not None else "unknown"
        _loaded[point.name] = Plugin(point.name, version)


@functools.cache
def _installed() -> tuple[EntryPoint, ...]:
    return tuple(sorted(entry_points(group=ENTRY_POINTS)))


def loaded() -> tuple[Plugin, ...]:
    """Plugins in the order of their names."""
    return tuple(sorted(_loaded.values()))


def _register_built_in() -> None:
    """Declare every group and register the kinds built in, as loading a scenario does too: plugins add to these."""
    _ = coopmm_jax.load_scenario


def _run(file: Path, content: bytes, option: str) -> None:
    _register_built_in()
    name = f"coopmm_jax_plugin_{file.stem}"
    spec = importlib.util.spec_from_loader(name, loader=None, origin=str(file))
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    module.__file__ = str(file)
    sys.modules[name] = module  # annotations are looked up there
    try:
        with registering(file.name):
            exec(_compiled(file, content), vars(module))
    except UserError:
        del sys.modules[name]
        raise
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise UserError(f"{option} {file.name}", "a file that runs", _told(error, file)) from None


def _compiled(file: Path, content: bytes) -> CodeType:
    return compile(content, str(file), "exec", dont_inherit=True)


def _told(error: BaseException, file: Path | None) -> str:
    """Exception in one line, with the line of the plugin that it comes from."""
    if isinstance(error, SyntaxError):
        return f"line {error.lineno}: {error.msg}"
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if file and frame.filename == str(file)]
    line = f"line {frames[-1].lineno}: " if frames else ""
    return f"{line}{type(error).__name__}: {error}"
