"""The on-disk cache of compiled functions: what it notices, and where it is stored."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from evopem import compilation as cache
from evopem.compilation import folder_digest

SCRIPTS = Path(__file__).parents[2] / "workflow" / "scripts"
INNER = """
from evopem.compilation import njit

@njit
def addend(x):
    return x + {number}
"""
KINDS = (
    INNER.format(number=1)
    + """
from typing import NamedTuple

class Kind(NamedTuple):
    number: int
"""
)
OUTER = """
from evopem.compilation import cached_njit
from package.inner import addend

@cached_njit
def total(x):
    return 10 * addend(x)
"""
RUN = """
from package.outer import total
print(total(1), sum(total.stats.cache_hits.values()), sum(total.stats.cache_misses.values()))
"""


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "inner.py").write_text(INNER.format(number=1))
    (folder / "outer.py").write_text(OUTER)
    return folder


def run(package, code=RUN, **environment):
    """Result, cache hits and cache misses of a new process, and what it wrote on stderr."""
    paths = os.pathsep.join([str(package.parent), str(SCRIPTS)])
    inherited = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    ended = subprocess.run(
        [sys.executable, "-B", "-c", code],
        env={**inherited, "PYTHONPATH": paths, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return tuple(int(number) for number in ended.stdout.split()), ended.stderr


def test_of_what_compiles_quickly_nothing_is_said(package):
    quick = OUTER.replace("@cached_njit", "@partial(cached_njit, is_quick=True)")
    (package / "outer.py").write_text("from functools import partial\n" + quick)
    assert run(package) == ((20, 0, 1), "")


def test_a_change_in_one_file_invalidates_what_other_files_compiled_and_a_touch_does_not(package):
    (found, message) = run(package)
    assert found == (20, 0, 1)
    assert message.count("compiling the numerical kernels") == 1
    os.utime(package / "inner.py", (1, 1))
    assert run(package) == ((20, 1, 0), "")
    (package / "inner.py").write_text(INNER.format(number=2))
    assert run(package)[0] == (30, 0, 1)


@pytest.mark.parametrize(("is_there", "compiled_here"), [(True, 0), (False, 1)])
def test_a_second_core_compiles_what_is_called_afterwards(
    package, is_there, compiled_here, monkeypatch
):
    # Files of the folder it is started in are no modules for it, as they are none for the first.
    monkeypatch.chdir(package)
    (package / "numba.py").write_text("raise ImportError")
    kernels = (
        OUTER.replace("total", "later") + "\ndef compile_kernels():\n    later(1)\n" * is_there
    )
    (package / "beside.py").write_text(kernels)
    first = OUTER.replace(
        "cached_njit\ndef", "partial(cached_njit, meanwhile='package.beside')\ndef"
    )
    (package / "outer.py").write_text("from functools import partial\n" + first)
    code = """
import sys
sys.path.remove("")
from package.beside import later
from package.outer import total
print(total(1), len(total.stats.cache_misses), later(1), len(later.stats.cache_misses))
"""
    assert run(package, code, NUMBA_NUM_THREADS="2")[0] == (20, 1, 20, compiled_here)
    assert run(package, code)[0] == (20, 0, 20, 0)


def test_what_a_second_core_compiles_is_all_that_a_first_estimate_calls_afterwards(package):
    code = """
from numpy.random import default_rng
from evopem import SearchSettings, estimate
from evopem.estimation.pem.kernels import gauss_newton, polynomials
from evopem.models.recursions import driven_states
gauss_newton.compile_kernels()
kernels = gauss_newton.gauss_newton_matrices, polynomials.filter_rows, driven_states
before = [len(kernel.signatures) for kernel in kernels]
settings = SearchSettings(mu=4, lambda_=4, nu=4, evaluations=1)
estimate(*default_rng(1).standard_normal((2, 300)), (2, 2, 2, 1), settings=settings)
print(*before, *(len(kernel.signatures) for kernel in kernels))
"""
    assert run(package, code)[0] == (1, 1, 1, 1, 1, 1)


def test_a_part_becomes_machine_code_only_with_what_calls_it(package):
    code = (
        RUN
        + """
from numba.core.registry import cpu_target
from package.inner import addend
defined = cpu_target.target_context.codegen()._engine.is_symbol_defined
for function in (addend, total):
    (compiled,) = function.overloads.values()
    print(int(defined(compiled.fndesc.llvm_func_name)))
"""
    )
    assert run(package, code)[0] == (20, 0, 1, 0, 1)


def test_a_change_of_how_functions_are_compiled_invalidates_those_of_other_folders(package):
    assert run(package)[0] == (20, 0, 1)
    changed = """
from evopem import compilation as cache
digest = cache._digest_once
cache._digest_once = lambda *of: digest(*of) + "x" * (of[1:] == ("compilation.py",))
"""
    assert run(package, changed + RUN)[0] == (20, 0, 1)


def test_what_is_loaded_does_not_import_what_numba_compiles_by(package):
    code = f"import sys{RUN}print(int('numba.np.linalg' in sys.modules))"
    assert run(package, code)[0] == (20, 0, 1, 1)
    assert run(package, code)[0] == (20, 1, 0, 0)


def test_types_of_a_module_that_is_gone_are_compiled_anew(package):
    for name in ("kinds", "sorts"):
        (package / f"{name}.py").write_text(KINDS)
        outer = OUTER.replace("addend(x)", "addend(x.number)").replace("inner", f"{name}")
        (package / "outer.py").write_text(outer)
        code = RUN.replace("total(1)", f"total(package.{name}.Kind(1))")
        assert run(package, f"import package.{name}" + code)[0] == (20, 0, 1)
        (package / f"{name}.py").rename(package / "gone")
    (package / "gone").rename(package / "sorts.py")
    assert run(package, f"import package.{name}" + code)[0] == (20, 1, 0)


def test_the_cache_goes_where_numba_is_told_and_a_job_says_in_its_log_that_it_compiles(
    package, tmp_path
):
    elsewhere, log = tmp_path / "cache", tmp_path / "dataset" / "logs" / "search.log"
    in_job = "from evopem.files.job import job\nwith job({log!r}):\n    {run}\n"
    code = in_job.format(log=str(log), run=RUN.strip().replace("\n", "\n    "))
    found, message = run(package, code, NUMBA_CACHE_DIR=str(elsewhere))
    assert found == (20, 0, 1)
    assert message.count("compiling the numerical kernels") == 1
    assert log.read_text().count("compiling the numerical kernels") == 1
    assert not (package / "__pycache__").exists()
    assert list(elsewhere.glob("*/*.nbc"))
    assert run(package, code, NUMBA_CACHE_DIR=str(elsewhere)) == ((20, 1, 0), "")
    assert "compiling" not in log.read_text()


def test_an_installation_that_is_not_writable_uses_the_users_cache(package, tmp_path):
    # A file in its place keeps even a superuser from writing to the folder.
    (package / "__pycache__").touch()
    home = tmp_path / "home"
    environment = {"HOME": str(home), "XDG_CACHE_HOME": str(home / ".cache")}
    assert run(package, **environment)[0] == (20, 0, 1)
    assert list(home.rglob("*.nbc"))
    assert run(package, **environment)[0] == (20, 1, 0)


def test_the_digest_covers_names_and_contents(package):
    digests = {folder_digest(package)}
    (package / "inner.py").rename(package / "other.py")
    digests.add(folder_digest(package))
    (package / "other.py").write_text("")
    digests.add(folder_digest(package))
    (package / "note.txt").touch()
    assert folder_digest(package) in digests
    assert len(digests) == 3


def test_nothing_is_collected_while_a_kernel_is_compiled_and_all_is_again_after_it():
    def failing():
        assert not gc.isenabled()
        raise TypeError

    assert gc.isenabled()
    assert not cache._without_collections()(gc.isenabled)()
    assert gc.isenabled()
    with pytest.raises(TypeError):
        cache._without_collections()(failing)()
    assert gc.isenabled()
