"""Jobs write nothing outside the working directory when there is no home folder."""

import subprocess
import sys

import pytest

from evopem.config.configuration import check_environment, job_environment
from evopem.errors import InputError


def test_a_usual_home_folder_is_left_to_the_libraries(tmp_path):
    wanted = job_environment({"HOME": str(tmp_path)}, tmp_path)
    assert "XDG_CACHE_HOME" not in wanted
    assert "MPLCONFIGDIR" not in wanted


def test_what_is_set_stays(tmp_path):
    given = {"HOME": "/nonexistent", "XDG_CACHE_HOME": "/c", "MPLCONFIGDIR": "/m"}
    given["OPENBLAS_CORETYPE"] = "Zen"
    assert job_environment(given, tmp_path) == {}


def test_without_a_home_folder_figures_create_none(tmp_path):
    home, work = tmp_path / "nonexistent", tmp_path / "work"
    work.mkdir()
    environment = {"HOME": str(home), "PATH": "/usr/bin:/bin"}
    environment |= job_environment(environment, work)
    code = "import matplotlib.pyplot as p; p.figure().savefig('f.svg')"
    subprocess.run([sys.executable, "-c", code], env=environment, cwd=work, check=True)
    assert (work / "f.svg").exists()
    assert not home.exists()
    assert {path.name for path in work.iterdir()} == {"f.svg", ".snakemake"}


def test_that_test_can_fail(tmp_path):
    """Without these variables matplotlib creates the home folder."""
    home = tmp_path / "nonexistent"
    code = "import matplotlib.pyplot"
    environment = {"HOME": str(home), "PATH": "/usr/bin:/bin"}
    subprocess.run([sys.executable, "-c", code], env=environment, cwd=tmp_path, check=True)
    assert home.exists()


def test_compilation_that_is_disabled_is_refused():
    check_environment({"NUMBA_DISABLE_JIT": "0"})
    with pytest.raises(InputError, match=r"^NUMBA_DISABLE_JIT: "):
        check_environment({"NUMBA_DISABLE_JIT": "1"})
