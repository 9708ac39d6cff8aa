"""Fixtures that several folders of tests share."""

import os

import pytest
from identified import Identified, identify_once


@pytest.fixture(scope="session")
def identified(tmp_path_factory) -> Identified:
    """A small synthetic data set, identified once a session."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    return identify_once(shared / "identified")
