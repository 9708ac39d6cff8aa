"""The modes of a record from state-space models of several orders, each with its evidence.

For each mode: which orders have it, whether the input reaches it, whether the predictor needs it
beside the noise, and how well it is known.  A mode is a group of poles of several orders that
agree (:mod:`evopem.models.mode_matching`); its numbers are those of the model of the chosen order
or, where that one lacks it, of the model of lowest BIC that has it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.models.mode_matching import cluster_modes
from evopem.models.modes import Mode
from evopem.models.stabilization import OrderModel
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording
from evopem.validation.held_out_tests import (
    HeldOutTest,
    joint_contribution_test,
)
from evopem.validation.modal_parts import ModalParts
from evopem.validation.mode_evidence import NO_TEST, SIGNIFICANCE, STABLE_SHARE, origin_of
from evopem.validation.mode_trust import doubts, plane_is_known, shape_doubt

if TYPE_CHECKING:
    from evopem.estimation.state_space.local_estimates import StateSpaceEstimate

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# A mode that the chosen order lacks is listed where this many orders have it.
PERSISTENT_ORDERS = 3


@dataclass(frozen=True)
class PoleOfOrder:
    """A pole of a stabilisation diagram.

    Attributes
    ----------
    order : int
    frequency_hz, damping_ratio : float
    frequency_se_hz, damping_se : float
        Standard errors.
    phase_collinearity : float
    mode : int or None
        Index of the row of the table that it belongs to; None where it belongs to none.
    """

    order: int
    frequency_hz: float
    damping_ratio: float
    frequency_se_hz: float
    damping_se: float
    phase_collinearity: float
    mode: int | None


@dataclass(frozen=True, eq=False)
class JudgedMode:
    """A mode with what the data say about it.

    Attributes
    ----------
    mode : Mode
    order : int
        Order of the model that it is taken from.
    orders : tuple of int
        Orders whose models have it.
    recurrence : float
        Share of the larger orders that have it; NaN where none is larger.
    stable : bool or None
        Whether that share is at least three quarters; None where it is not known.
    input_test : HeldOutTest
        Of the mode's response to the inputs, on held-out samples, beside the responses of all
        other modes; one test of all outputs.
    reached : bool or None
        Whether the inputs reach the mode, by ``input_test``; None where it is not possible.
    noise_test : HeldOutTest
        The same of what the mode adds, driven by past innovations, to one-step predictions.
    needed_by_noise : bool or None
        Whether it adds to them, by ``noise_test``.  False for an output-error model.
    doubts : tuple of str
        Reasons not to trust it, see :func:`evopem.validation.mode_trust.doubts`.
    shape_doubt : str
        Reason not to trust its shape, see :func:`evopem.validation.mode_trust.shape_doubt`.
    pair : int or None
        Of a shape that is doubted: the row of the table with the neighbour whose shape spans with
        this one a plane that is known.
    """

    mode: Mode
    order: int
    orders: tuple[int, ...]
    recurrence: float
    stable: bool | None
    input_test: HeldOutTest
    reached: bool | None
    noise_test: HeldOutTest
    needed_by_noise: bool | None
    doubts: tuple[str, ...] = ()
    shape_doubt: str = ""
    pair: int | None = None

    @property
    def has_input(self) -> bool:
        """Whether the model of the mode has an input."""
        return len(self.mode.input_participation) > 0

    @property
    def origin(self) -> str:
        """What drives the mode: ``input``, ``noise``, ``neither`` or ``not judged``."""
        return origin_of(self.reached, self.needed_by_noise)

    @property
    def trusted(self) -> bool:
        """Whether there is no reason to doubt it, its shape aside."""
        return not self.doubts

    @property
    def shape_trusted(self) -> bool:
        """Whether there is no reason to doubt its shape either."""
        return self.trusted and not self.shape_doubt


@dataclass(frozen=True, eq=False)
class ModeTable:
    """Modes of a record, by frequency, and the poles of all orders.

    Attributes
    ----------
    order : int
        The order that was chosen.
    orders : tuple of int
        All orders.
    modes : tuple of JudgedMode
    poles : tuple of PoleOfOrder
        By order and frequency.
    """

    order: int
    orders: tuple[int, ...]
    modes: tuple[JudgedMode, ...]
    poles: tuple[PoleOfOrder, ...]

    @property
    def trusted(self) -> tuple[Mode, ...]:
        """The modes that nothing speaks against."""
        return tuple(each.mode for each in self.modes if each.trusted)


def mode_table(
    estimates: Sequence[StateSpaceEstimate],
    recording: Recording,
    first: int | None = None,
) -> ModeTable:
    """Collect the modes of models of several orders, each with its evidence.

    Parameters
    ----------
    estimates : sequence of StateSpaceEstimate
        Models of consecutive orders, at least three above the number that the record needs.
    recording : Recording
        Ends with the held-out samples; may begin with the estimation samples.
    first : int, optional
        First held-out sample of each segment; by default there are none, and the tests are not
        possible.

    Raises
    ------
    ValueError
        When the signals have other channels than the models.
    """
    models = [OrderModel.of_estimate(each) for each in estimates]
    chosen = min(models, key=lambda each: each.bic).order
    return table_of_models(models, chosen, recording, first)


def table_of_models(
    models: Sequence[OrderModel],
    chosen: int,
    recording: Recording,
    first: int | None = None,
) -> ModeTable:
    """The table of models of several orders, of which one was chosen.

    Parameters
    ----------
    models : sequence of OrderModel
        By order.
    chosen : int
        The order whose modes are all listed.
    recording, first
        As of :func:`mode_table`.

    Raises
    ------
    ValueError
        As there.
    """
    u, y = recording.segment_inputs, recording.segment_outputs
    first = max(map(len, y)) if first is None else first
    by_order = {each.order: each for each in models}
    orders = tuple(by_order)
    tests: dict[int, list[tuple[HeldOutTest, HeldOutTest]]] = {}
    judged: list[JudgedMode] = []
    row_of: dict[tuple[int, int], int] = {}
    for group in cluster_modes({order: each.modes for order, each in by_order.items()}):
        if chosen not in group and len(group) < PERSISTENT_ORDERS:
            continue
        own = chosen if chosen in group else min(group, key=lambda order: by_order[order].bic)
        found = by_order[own]
        if own not in tests:
            tests[own] = held_out_mode_tests(found.model, found.modes, u, y, first)
        row_of |= {(order, index): len(judged) for order, index in group.items()}
        judged.append(
            _judged(
                found.modes[group[own]],
                own,
                tuple(sorted(group)),
                tests[own][group[own]],
                found.model,
                orders,
            )
        )
    poles = tuple(
        PoleOfOrder(
            order=order,
            frequency_hz=mode.frequency_hz,
            damping_ratio=mode.damping_ratio,
            frequency_se_hz=mode.frequency_se_hz,
            damping_se=mode.damping_se,
            phase_collinearity=mode.phase_collinearity,
            mode=row_of.get((order, index)),
        )
        for order, each in by_order.items()
        for index, mode in enumerate(each.modes)
    )
    return ModeTable(chosen, orders, _with_pairs(judged, by_order, row_of), poles)


def _with_pairs(
    judged: Sequence[JudgedMode],
    by_order: Mapping[int, OrderModel],
    row_of: Mapping[tuple[int, int], int],
) -> tuple[JudgedMode, ...]:
    """The modes, those of doubted shape with the neighbour that they span a known plane with."""
    found = []
    for each in judged:
        mode, pair = each.mode, None
        if each.shape_doubt and mode.partner is not None:
            partner = by_order[each.order].modes[mode.partner]
            if plane_is_known(mode, partner):
                pair = row_of.get((each.order, mode.partner))
        found.append(replace(each, pair=pair))
    return tuple(found)


def held_out_mode_tests(
    model: StateSpaceModel,
    modes: Sequence[Mode],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    first: int,
) -> list[tuple[HeldOutTest, HeldOutTest]]:
    """Test, for each mode, its response to the inputs and its part of one-step predictions.

    The output is regressed on what the mode contributes, beside the contributions of all others:
    of two poles that cancel each other's response neither may pass because the other is there.

    Parameters
    ----------
    model : StateSpaceModel
        Stable, with a stable predictor.
    modes : sequence of Mode
        Those of the model.
    inputs, outputs : sequences of (N, nu) and (N, ny) arrays
        One record or several, that each begin with a state of their own.
    first : int
        First held-out sample of each record.
    """
    records = [
        ModalParts.of(model, modes, u, y, first)
        for u, y in zip(inputs, outputs, strict=True)
        if first < len(y)
    ]
    tests = []
    for index in range(len(modes)):
        of_input, of_noise = NO_TEST, NO_TEST
        if records and model.inputs:
            of_input = joint_contribution_test([each.of_input(index) for each in records])
        if records and model.structure == "ss":
            of_noise = joint_contribution_test([each.of_noise(index) for each in records])
        tests.append((of_input, of_noise))
    return tests


def _judged(
    mode: Mode,
    own: int,
    orders: tuple[int, ...],
    tests: tuple[HeldOutTest, HeldOutTest],
    model: StateSpaceModel,
    all_orders: Sequence[int],
) -> JudgedMode:
    of_input, of_noise = tests
    recurrence = _recurrence(own, orders, all_orders)
    judged = JudgedMode(
        mode=mode,
        order=own,
        orders=orders,
        recurrence=recurrence,
        stable=None if math.isnan(recurrence) else recurrence >= STABLE_SHARE,
        input_test=of_input,
        reached=of_input.significant(SIGNIFICANCE) if model.inputs else False,
        noise_test=of_noise,
        needed_by_noise=(of_noise.significant(SIGNIFICANCE) if model.structure == "ss" else False),
    )
    return replace(
        judged,
        doubts=tuple(doubts(judged, model.sampling_rate)),
        shape_doubt=shape_doubt(mode),
    )


def _recurrence(own: int, orders: Sequence[int], all_orders: Sequence[int]) -> float:
    """Share of the larger orders that have a mode; smaller ones lose true modes first."""
    larger = [order for order in all_orders if order > own]
    return float(np.mean([order in orders for order in larger])) if larger else math.nan
