"""Compilation by numba, with an on-disk cache that notices changes in a whole folder.  numba's own
cache compares a digest of the one file that defines a function; here the digest covers every Python
file of that folder, which what it calls is defined in, and this file, which compiles it."""

import gc
import hashlib
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core import caching
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import register_pass
from numba.core.config import NUMBA_NUM_THREADS  # type: ignore[attr-defined]
from numba.core.runtime import rtsys
from numba.core.typed_passes import NativeLowering

LOGGER = logging.getLogger("evopem")

# Of signals of unit size; below it a free response is 0.  Its own end would be subnormal numbers,
# which it never leaves, and which are a hundred times slower in all that follows.
DECAYED = 1e-150

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}


class _PartLibrary(JITCodeLibrary):
    """Code that is optimised, and becomes machine code, only with the functions that call it: by
    itself as well it would be so once for each of them."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):
    """Lowering into such a library, of a function that Python cannot call."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state["cr"]
        names = lowered.fndesc.lookup_module(), *[lowered.fndesc.qualname] * 2
        nowhere = _dynfunc.make_function(*names, 0, lowered.env, (state.library,))
        state.targetctx.insert_user_function(nowhere, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=nowhere)
        return True


class _PartCompiler(Compiler):
    """numba's compiler, which lowers a part of others."""

    def define_pipelines(self) -> list[Any]:
        (manager,) = super().define_pipelines()
        instead = {NativeLowering: _PartLowering}
        manager.passes = [(instead.get(step, step), title) for step, title in manager.passes]
        manager.finalize()
        return [manager]


_ALLOCATING_PART = {**_OPTIONS, "no_cpython_wrapper": True, "pipeline_class": _PartCompiler}
_PART = {**_ALLOCATING_PART, "_nrt": False}


def njit(function: Callable[..., Any]) -> Any:
    """Compile a function that only compiled functions call: not kept, not callable from Python.
    It makes no arrays, so that references to arrays need not be counted."""
    return numba.njit(**_PART)(function)


def allocating_njit(function: Callable[..., Any]) -> Any:
    """The same of a function that makes, or returns, arrays."""
    return numba.njit(**_ALLOCATING_PART)(function)


def cached_njit(
    function: Callable[..., Any], is_quick: bool = False, meanwhile: str | None = None
) -> Any:
    """Compile a function that Python calls, on first use, and keep the result on disk.  What it
    calls must be defined in the same folder, or be compiled by numba itself.  Of a quick one that
    not every first search needs nothing is said.  ``meanwhile``: a module whose
    ``compile_kernels()`` a process on another core calls, for those that are called afterwards."""
    dispatcher: Any = numba.njit(**_OPTIONS)(function)
    dispatcher._cache = _FolderCache(function)
    dispatcher._cache.is_quick, dispatcher._cache.meanwhile = is_quick, meanwhile
    dispatcher._compiler.compile = _without_collections()(dispatcher._compiler.compile)
    return dispatcher


@contextmanager
def _without_collections() -> Iterator[None]:
    """Do not search for garbage in all that a compiler keeps: a twentieth of its time."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()


def folder_digest(folder: Path, names: str = "*.py") -> str:
    """Digest of the names and contents of the Python files of a folder, 64 digits."""
    digest = hashlib.sha256()
    for file in sorted(folder.glob(names)):
        digest.update(file.name.encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


# The sources that were imported count, not what became of them while the process runs.
_digest_once = cache(folder_digest)


class _FolderStamp:
    """Cache locators whose source stamp is the digest of a folder."""

    _py_file: str

    def get_source_stamp(self) -> str:
        compiler = Path(__file__)
        kernels = _digest_once(Path(self._py_file).parent)
        return kernels + _digest_once(compiler.parent, compiler.name)


class _FolderCacheImplementation(caching.CompileResultCacheImpl):
    _locator_classes: list[type[object]] = [  # noqa: RUF012 - as numba declares it
        type(locator.__name__, (_FolderStamp, locator), {})
        for locator in (
            caching.UserProvidedCacheLocator,
            caching.InTreeCacheLocator,
            caching.UserWideCacheLocator,
        )
    ]

    def reduce(self, cres: Any) -> Any:
        # Without the environments of what is called, whose modules would be imported again: they
        # hold objects of Python, which no kernel uses.
        return *super().reduce(cres)[:-1], ()


class _FolderCache(caching.FunctionCache):
    """numba's cache of one function, with the folder's digest as source stamp."""

    _impl_class = _FolderCacheImplementation
    is_quick: bool
    meanwhile: str | None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        # What is loaded needs the counts of references alone, not all that numba compiles by, which
        # the method of the base class imports: a third of a small estimate.
        rtsys.initialize(target_context)
        loaded = self._loaded(sig, target_context)
        if loaded is None and not self.is_quick:
            _announce(os.getpid())
            if self.meanwhile is not None and NUMBA_NUM_THREADS > 1:
                with suppress(OSError):  # no further process may be started
                    _ELSEWHERE.append(_compiling(self.meanwhile))
            elif _ELSEWHERE:
                _ELSEWHERE.pop().wait()
                loaded = self._loaded(sig, target_context)
        return loaded

    def _loaded(self, sig: Any, target_context: Any) -> Any:
        try:
            return self._load_overload(sig, target_context)
        except (ImportError, AttributeError):
            # The index names what another version of the package had.
            self._cache_file.flush()
            return None


# The process that compiles for this one, until it is waited for.
_ELSEWHERE: list[subprocess.Popen[bytes]] = []


def _compiling(module: str) -> subprocess.Popen[bytes]:
    """A process that compiles the kernels of a module.  Where it fails, they are compiled here."""
    return subprocess.Popen(
        # Without the folder it is started in, whose files may have the names of modules.
        [sys.executable, "-P", "-c", f"from {module} import compile_kernels; compile_kernels()"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@cache
def _announce(process: int) -> None:  # noqa: ARG001 - once a process
    """Say on standard error, and in the log of a job, why the first search takes longer."""
    message = "compiling the numerical kernels (6 to 15 s, once after an installation)"
    sys.stderr.write(f"evopem: {message}\n")
    LOGGER.info(message)
