"""Fixtures that several folders of tests share."""

import gc
import os

# Before numpy is loaded: on several cores, threads of BLAS wait for each other for most of the time
# that a small decomposition takes.  The package itself holds BLAS to one thread where it computes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Tests start hundreds of processes that import the package: each would compile all of it again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import pytest
from identified import Identified, identify_once, without_figures

# Looked through less often for garbage, four thousand collected tests take less of the time.
gc.set_threshold(20_000, 20, 20)


@pytest.fixture(scope="session")
def identified(tmp_path_factory) -> Identified:
    """A small synthetic data set, identified once a session."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    return identify_once(shared / "identified")


@pytest.fixture
def undrawn():
    """Reports without their figures."""
    with without_figures():
        yield
