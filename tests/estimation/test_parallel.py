"""A pool of processes of which one is killed."""

import os
import signal

import numpy as np
import pytest

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.errors import InputError
from evopem.estimation import order_selection
from evopem.models.orders import armax_orders
from evopem.signals.recording import Recording


def test_a_killed_process_is_named_in_one_sentence(monkeypatch):
    """As the system's out-of-memory killer ends one."""
    rows = np.random.default_rng(0).standard_normal((300, 2))
    recording = Recording(
        inputs=rows[:, 0].copy(),
        outputs=rows[:, 1].copy(),
        sampling_rate=100.0,
        input_names=("u",),
        output_names=("y",),
    )
    monkeypatch.setattr(
        order_selection, "end_with_parent", lambda: os.kill(os.getpid(), signal.SIGKILL)
    )
    orders = [armax_orders(order, order, order, 1) for order in (1, 2, 3, 4)]
    with pytest.raises(InputError, match=r"^the candidates of phase plant: .+ was killed"):
        order_selection.estimate_in_parallel(
            order_selection.OrderSearch(recording, SearchSettings(), ScoringWindow(5, 25)),
            orders,
            "plant",
            cores=2,
        )
