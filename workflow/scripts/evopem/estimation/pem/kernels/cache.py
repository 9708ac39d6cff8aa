"""Compilation by numba, with an on-disk cache that notices changes in a whole folder.  numba's own
cache compares a digest of the one file that defines a function; here the digest covers every Python
file of that folder, which what it calls is defined in."""

import hashlib
import logging
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

LOGGER = logging.getLogger("evopem")

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
_INNER: dict[str, Any] = {"no_cpython_wrapper": True}


def njit(function: Callable[..., Any]) -> Any:
    """Compile a function that only compiled functions call: not kept, not callable from Python."""
    return numba.njit(**_OPTIONS, **_INNER)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a large function into the one place that calls it, and not by itself as well."""
    return numba.njit(inline="always", **_OPTIONS, **_INNER)(function)


def cached_njit(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, on first use, and keep the result on disk.  What it
    calls must be defined in the same folder, or be compiled by numba itself."""
    dispatcher: Any = numba.njit(**_OPTIONS)(function)
    dispatcher._cache = _FolderCache(function)
    return dispatcher


def folder_digest(folder: Path) -> str:
    """Digest of the names and contents of the Python files of a folder, 64 digits."""
    digest = hashlib.sha256()
    for file in sorted(folder.glob("*.py")):
        digest.update(file.name.encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


# The sources that were imported count, not what became of them while the process runs.
_digest_once = cache(folder_digest)


class _FolderStamp:
    """Cache locators whose source stamp is the digest of a folder."""

    _py_file: str

    def get_source_stamp(self) -> str:
        return _digest_once(Path(self._py_file).parent)


class _FolderCacheImplementation(caching.CompileResultCacheImpl):
    _locator_classes: list[type[object]] = [  # noqa: RUF012 - as numba declares it
        type(locator.__name__, (_FolderStamp, locator), {})
        for locator in (
            caching.UserProvidedCacheLocator,
            caching.InTreeCacheLocator,
            caching.UserWideCacheLocator,
        )
    ]


class _FolderCache(caching.FunctionCache):
    """numba's cache of one function, with the folder's digest as source stamp."""

    _impl_class = _FolderCacheImplementation

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            loaded = super().load_overload(sig, target_context)
        except (ImportError, AttributeError):
            # The index names what another version of the package had.
            self._cache_file.flush()
            loaded = None
        if loaded is None:
            _announce(os.getpid())
        return loaded


@cache
def _announce(process: int) -> None:  # noqa: ARG001 - once a process
    """Say on standard error, and in the log of a job, why the first search takes longer."""
    message = "compiling the numerical kernels (20 to 40 s, once after an installation)"
    sys.stderr.write(f"evopem: {message}\n")
    LOGGER.info(message)
