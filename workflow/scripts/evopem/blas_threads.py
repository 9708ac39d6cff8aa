"""One thread for BLAS: the bits of a result must not depend on how many a machine would take."""

import sys
from contextlib import AbstractContextManager
from functools import lru_cache

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[object]:
    """Hold all loaded libraries of linear algebra to one thread in a ``with`` block."""
    # A library is loaded when a module is imported, and modules stay in the order of their import.
    limiter: AbstractContextManager[object] = _controller(
        len(sys.modules), next(reversed(sys.modules))
    ).limit(limits=1, user_api="blas")
    return limiter


@lru_cache(maxsize=1)
def _controller(_modules: int, _latest: str) -> ThreadpoolController:
    """The libraries that are loaded: looking for them takes milliseconds."""
    return ThreadpoolController()
