"""The modes of models of several orders, each with its evidence and reasons to doubt it.

A mode is a group of poles of several orders that agree; its numbers are those of the model of the
chosen order or, where that one does not have it, of the model of lowest BIC that has it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from evopem.arrays import Array
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate
from evopem.models.mode_matching import (
    PERSISTENT_ORDERS,
    OrderModel,
    PoleOfOrder,
    cluster_modes,
    may_be,
    stabilization,
)
from evopem.models.modes import Mode, assurances
from evopem.models.parameter_covariance import NORMAL_95
from evopem.models.response_tables import Column, shaped_modes_table
from evopem.signals.recording import Recording
from evopem.validation import modal_parts
from evopem.validation.held_out_tests import NO_TEST, SIGNIFICANCE, HeldOutTest
from evopem.validation.responses import HeldOut, Model, divided
from evopem.validation.spectra import EXCITED

# Share of the other orders in which a stable mode is found again; level of the test of its response
# at which all with enough poles are enough, where there are no larger ones.
STABLE_SHARE, CERTAIN = 0.75, 1e-6
# Damping ratio above which a pair of poles is hardly a resonance, above which one without an input
# may be the colour of the unknown force, and above which it may be so where its shape is doubted:
# forces of one colour at several places have about the same pole each.
STRONG_DAMPING, COLOUR_OF_FORCE, COLOUR_OF_FORCES = 0.5, 0.2, 0.03
# Share of an output's power below which a mode is not trusted: 40 dB, as of inputs.
LEAST_POWER = EXCITED
# Largest relative half width of the 95 % interval of a frequency; a wider bandwidth replaces it.
WIDEST_INTERVAL = 0.1
# Decay in a sample, relative to the amplitude, that no record of usual length shows.
NO_DECAY = 1e-6
FINITE = "may describe a finite impulse response, which has no modes"
# Level of the test that tells two poles apart, and smallest assurance (MAC) that a known shape is
# expected to have with the true one: that of well correlated shapes (Ewins 2000).
POLES_APART, KNOWN_SHAPE = 0.01, 0.9


@dataclass(frozen=True, eq=False)
class ModeEvidence:
    """A mode with what the data say about it."""

    mode: Mode
    order: int  # order of the model that it is taken from
    orders: tuple[int, ...]  # orders whose models have it
    # Share of the other orders that have it.  One without it counts only where its model has
    # more poles than all modes need: else that says nothing.  NaN where there are none
    recurrence: float
    # Of the mode's response to the inputs, on held-out samples beside the responses of all other
    # modes; one test of all outputs
    input_test: HeldOutTest
    # reached, needed_by_noise: whether they are significant; None where a test was not possible
    reached: bool | None
    # Of one-step predictions with the pole in the noise filter: of one output against those without
    # it and the zeros nearest to it, of several of what the mode adds, driven by past innovations,
    # beside all other modes
    needed_by_noise: bool | None  # and whether a smaller model without it predicts worse
    # Largest share of the mode's response in the power of a held-out output; NaN where not known
    power_share: float = math.nan
    doubts: tuple[str, ...] = ()  # reasons not to trust it, see :func:`doubts`
    shape_doubt: str = ""  # reason not to trust its shape, see :func:`shape_doubt`
    compared: int = 0  # number of orders that the recurrence is a share of
    confirmed: bool = True  # whether there are larger orders, or the largest ones have it alike
    # Of a shape that is doubted: the row of the table with the neighbour whose shape spans with
    # this one a plane that is known
    pair: int | None = None
    model: str = ""  # that it is taken from, where it is another than the chosen one

    @property
    def has_input(self) -> bool:
        """Whether the model of the mode has an input."""
        return len(self.mode.input_participation) > 0

    @property
    def stable(self) -> bool | None:
        """Whether enough of the other orders have it; None where there are none."""
        return None if math.isnan(self.recurrence) else self.recurrence >= STABLE_SHARE

    @property
    def origin(self) -> str:
        """What drives the mode: ``input``, ``noise``, ``neither`` or ``not judged``."""
        if self.reached:
            return "input"
        if self.needed_by_noise:
            return "noise"
        if self.reached is None or self.needed_by_noise is None:
            return "not judged"
        return "neither"

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
    """Modes by frequency, poles of all orders by order and frequency, and how alike shapes are."""

    order: int  # that was chosen
    orders: tuple[int, ...]
    modes: tuple[ModeEvidence, ...]
    poles: tuple[PoleOfOrder, ...]
    assurance: tuple[tuple[float, ...], ...]  # modal assurance criterion of each pair of shapes

    @property
    def trusted(self) -> tuple[Mode, ...]:
        """The modes that nothing speaks against."""
        return tuple(mode.mode for mode in self.modes if mode.trusted)

    def rows(self, input_names: Sequence[str], output_names: Sequence[str]) -> dict[str, Column]:
        """One row for each mode and output, as ``modes.csv`` has them."""
        columns = shaped_modes_table([row.mode for row in self.modes], input_names, output_names)
        judged = [mode for mode in self.modes for _ in output_names]
        names = ("model", "order", "recurrence", "origin")
        return columns | {
            **{name: [getattr(row, name) for row in judged] for name in names},
            "trusted": [str(judged_mode.trusted) for judged_mode in judged],
            "doubts": ["; ".join(judged_mode.doubts) for judged_mode in judged],
            "shape_assurance": [judged_mode.mode.shape_assurance for judged_mode in judged],
            "shape_trusted": [str(judged_mode.shape_trusted) for judged_mode in judged],
            "shape_doubt": [judged_mode.shape_doubt for judged_mode in judged],
            "plane_with_mode": ["" if j.pair is None else str(j.pair + 1) for j in judged],
        }


def mode_table(
    estimates: Sequence[StateSpaceEstimate], recording: Recording, first: int | None = None
) -> ModeTable:
    """Collect the modes of models of several orders, each with its evidence.

    ``estimates``: of consecutive orders, at least three above the number that the record needs.
    ``recording``: ends with the held-out samples; may begin with the estimation samples.
    ``first``: held-out sample of each segment; by default there are none, and no tests.
    ValueError where the recording has other channels than the models.
    """
    models = [OrderModel.of(e.model.order, e.bic, e.model) for e in estimates]
    chosen = min(models, key=lambda model: model.bic).order
    if first is None:
        return table_of_models(models, chosen)
    return table_of_models(models, chosen, lambda model: divided(model, recording, first))


def table_of_models(
    models: Sequence[OrderModel],
    chosen: int,
    held_out: Callable[[Model], Sequence[HeldOut]] = lambda _: (),
    estimation: Callable[[Model], Sequence[HeldOut]] = lambda _: (),
) -> ModeTable:
    """The table of models of several orders, of which one was chosen.

    ``models``: by order.  ``chosen``: the order whose modes are all listed.  ``held_out``: gives
    the stretches for the tests of a model; without any they are not possible.  ``estimation``:
    gives those that the model was estimated from.
    """
    by_order = {model.order: model for model in models}
    tests: dict[int, list[modal_parts.ModeTests]] = {}
    of_model: dict[int, tuple[float, HeldOutTest]] = {}  # most samples, and the outlasting test
    squares: dict[int, Array] = {}  # of one-step errors of each output, their means
    judged: list[ModeEvidence] = []
    row_of: dict[tuple[int, int], int] = {}
    for group in cluster_modes({order: model.modes for order, model in by_order.items()}):
        if chosen not in group and len(group) < PERSISTENT_ORDERS:
            continue
        order = chosen if chosen in group else min(group, key=lambda order: by_order[order].bic)
        nearby = by_order[order]
        if order not in tests:
            records, known = held_out(nearby.model), estimation(nearby.model)
            tests[order] = modal_parts.held_out_mode_tests(nearby.modes, records, known)
            lengths = (len(record.outputs) for record in (*records, *known))
            outlasting = modal_parts.outlasting_test(records, known)
            of_model[order] = max(lengths, default=math.inf), outlasting
        of_mode = tests[order][group[order]]
        mode, without = nearby.modes[group[order]], None
        below = [m for m in models if m.order < order and m.order not in group]
        lacking = [m for m in below if not may_be(mode, m.modes)]
        if lacking and math.isfinite(of_mode[1].p_value):
            best = min(lacking, key=lambda model: model.bic)
            for model in (best, nearby):
                if model.order not in squares:
                    squares[model.order] = _mean_squares(held_out(model.model))
            without = float(np.mean(squares[best.order] / squares[order]))
        row_of |= {(order, index): len(judged) for order, index in group.items()}
        of_group = nearby, group, of_mode, by_order
        judged.append(_judged(*of_group, *of_model[order], without, chosen))
    poles = stabilization({order: model.modes for order, model in by_order.items()}, row_of)
    trusted = [row for row in judged if row.trusted]
    for row in trusted:
        # Only trusted modes vouch for others, and none for one that is not driven clearly.
        beside = [neighbour.mode for neighbour in trusted if row.order in neighbour.orders]
        clear = not row.has_input or modal_parts.is_driven_clearly(row.input_test)
        if modal_parts.is_short(by_order[row.order].model, beside if clear else [row.mode]):
            judged[judged.index(row)] = replace(row, doubts=(FINITE,))
    rows = _with_pairs(judged, by_order, row_of)
    alike = assurances([row.mode.shape for row in rows])
    return ModeTable(chosen, tuple(by_order), rows, tuple(poles), alike)


def _mean_squares(held_out: Sequence[HeldOut]) -> Array:
    """Mean square of the one-step errors of each output, (l,)."""
    with np.errstate(all="ignore"):
        errors = [(h.recording.outputs - h.predicted())[h.unscored :] for h in held_out]
        return np.asarray(np.mean(np.concatenate(errors) ** 2, axis=0))


def with_noise_modes(table: ModeTable, modes: Sequence[Mode], inputs: int) -> ModeTable:
    """A table with the modes of the noise filter alone behind those of the plant."""
    known = {mode.mode.pole for mode in table.modes}
    nothing = np.zeros(inputs, dtype=complex)
    untested = tuple(
        ModeEvidence(
            mode=replace(mode, input_participation=nothing),
            order=table.order,
            orders=(),
            recurrence=math.nan,
            input_test=NO_TEST,
            reached=None,
            needed_by_noise=None,
            doubts=("is of the noise filter alone, and was not tested",),
        )
        for mode in modes
        if mode.pole not in known
    )
    return replace(table, modes=table.modes + untested)


def _judged(
    order_model: OrderModel,
    group: Mapping[int, int],
    tests: modal_parts.ModeTests,
    by_order: Mapping[int, OrderModel],
    samples: float,
    outlasts: HeldOutTest,
    without: float | None,
    chosen: int,
) -> ModeEvidence:
    """A mode judged.  ``outlasts``: :func:`outlasting_test` of its model.  ``without``: squared
    errors of the best smaller model without it to its own: a superfluous pole may seem needed."""
    mode, model = order_model.modes[group[order_model.order]], order_model.model
    of_input, of_noise, power_share = tests
    needed = of_noise.significant(SIGNIFICANCE)
    if needed and without is not None:
        needed = not without <= 1.0  # a smaller model may fail with errors that are not finite
    others = [m for m in by_order.values() if m is not order_model]
    poles = 2 * len(order_model.modes)
    compared = [m for m in others if m.order in group or modal_parts.pole_count(m.model) > poles]
    ending = sorted(by_order)[-PERSISTENT_ORDERS:]
    inside = len(by_order) == 1 or chosen < ending[-1]
    shared = len(group) > 1 and group.keys() >= {m.order for m in compared}
    judged = ModeEvidence(
        mode=mode,
        order=order_model.order,
        orders=tuple(sorted(group)),
        recurrence=float(np.mean([m.order in group for m in compared])) if compared else math.nan,
        compared=len(compared),
        confirmed=inside or group.keys() >= set(ending) or (shared and of_input.p_value < CERTAIN),
        input_test=of_input,
        reached=of_input.significant(SIGNIFICANCE) if model.inputs else False,
        needed_by_noise=needed if np.any(mode.noise_participation) else False,
        power_share=power_share,
    )
    slow = modal_parts.keeps_half(model, mode) and not outlasts.would_show(SIGNIFICANCE)
    behind = outlasts.significant(SIGNIFICANCE) is not False or judged.needed_by_noise or slow
    finite = not behind or modal_parts.is_short(model, order_model.modes)
    reasons = tuple(doubts(judged, model.sampling_rate, samples, finite))
    return replace(judged, doubts=reasons, shape_doubt=shape_doubt(mode))


def _with_pairs(
    judged: Sequence[ModeEvidence],
    by_order: Mapping[int, OrderModel],
    row_of: Mapping[tuple[int, int], int],
) -> tuple[ModeEvidence, ...]:
    """The modes, those of doubted shape with the neighbour that they span a known plane with."""
    modes = []
    for judged_mode in judged:
        mode, pair = judged_mode.mode, None
        mixed = len(mode.shape) > 2 and mode.equal_poles_p > POLES_APART
        if judged_mode.shape_doubt and mixed and mode.partner is not None:
            partner = by_order[judged_mode.order].modes[mode.partner]
            if min(mode.plane_assurance, partner.plane_assurance) >= KNOWN_SHAPE:
                pair = row_of.get((judged_mode.order, mode.partner))
        modes.append(replace(judged_mode, pair=pair))
    return tuple(modes)


def doubts(
    evidence: ModeEvidence, sampling_rate: float, samples: float = math.inf, finite: bool = False
) -> list[str]:
    """Reasons to doubt a mode, each a predicate such as "decays too fast to be a resonance".

    A mode is trusted when there is none.  ``samples``: of the longest stretch, within which it
    decays unless inputs reach it, clearly or with a known damping.  ``finite``: the response may be
    a finite one.
    """
    mode, reasons = evidence.mode, []
    driven = modal_parts.is_driven_clearly(evidence.input_test)
    clear = driven and (evidence.confirmed or evidence.stable is not False)
    lasts = driven or modal_parts.has_known_damping(mode)
    decay = 2.0 * math.pi * mode.damping_ratio * mode.frequency_hz / sampling_rate
    colour = COLOUR_OF_FORCES if shape_doubt(mode) else COLOUR_OF_FORCE
    if mode.damping_ratio > STRONG_DAMPING or mode.frequency_hz > sampling_rate / 2:
        reasons.append("decays too fast to be a resonance")
    elif not evidence.has_input and mode.damping_ratio > colour:
        reasons.append(
            f"has a damping ratio of {100 * mode.damping_ratio:.0f} %: without an input that is as"
            " likely the colour of the force"
        )
    if decay <= NO_DECAY * (not clear):
        reasons.append("does not decay")
    elif decay * samples < 1.0 and not (evidence.reached and lasts):
        reasons.append("hardly decays within the record")
    if finite:
        reasons.append(FINITE)
    if evidence.power_share < LEAST_POWER:
        reasons.append(f"carries less than {100 * LEAST_POWER:g} % of the power of any output")
    if evidence.origin == "neither":
        reasons.append(
            "shows neither in the response to the input nor in the noise"
            if evidence.has_input
            else "does not improve the prediction of the samples that judge it"
        )
    elif evidence.origin == "not judged":
        reasons.append("could not be tested: few samples judge it, or without power there")
    if evidence.stable is False and not clear:
        of_them = round(evidence.recurrence * evidence.compared)
        others = len(evidence.orders) - 1 - of_them
        few = f"only {of_them}" if of_them else "none"
        sharing = f"{few} of the {evidence.compared} other orders with enough poles share"
        if evidence.compared == 1:
            sharing = "the only other order with enough poles does not share"
        more = f", and {others} with fewer do" if others > 0 else ""
        reasons.append(f"{sharing} its frequency and damping{more}")
    if not (evidence.confirmed or clear):
        reasons.append(
            f"is not in all of the last orders, up to {PERSISTENT_ORDERS}; there is no larger one"
        )
    half_width = NORMAL_95 * mode.frequency_se_hz
    if not math.isfinite(half_width):
        reasons.append("has no known standard error")
    elif half_width > max(WIDEST_INTERVAL, mode.damping_ratio) * mode.frequency_hz:
        reasons.append("has a frequency known to no better than 10 % or its bandwidth")
    return reasons


def shape_doubt(mode: Mode) -> str:
    """Reason to doubt a mode's shape though not its frequency and damping; empty for none."""
    if len(mode.shape) < 2 or not math.isfinite(mode.shape_assurance):
        return ""
    if mode.equal_poles_p > POLES_APART:
        return "the data do not separate its pole from a neighbour’s, so that shapes may be mixed"
    if mode.shape_assurance < KNOWN_SHAPE:
        return f"a MAC of only {mode.shape_assurance:.2f} is expected with the true shape"
    return ""
