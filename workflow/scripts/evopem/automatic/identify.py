"""Automatic identification: from recordings to models, each step decided and recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.automatic.candidates import Scorer, StructureSearch
from evopem.automatic.decision import Decision, Trial
from evopem.automatic.held_out.folds import decide_folds
from evopem.automatic.held_out.simulation import simulated
from evopem.automatic.orders import NESTED, decide_delays, search_structure
from evopem.automatic.preparation.plan import PreparedRecord, decide_preparation, prepare
from evopem.automatic.remedies import act_on_checks
from evopem.automatic.structures import Choice, Purpose, compare_structures
from evopem.blas_threads import one_blas_thread
from evopem.errors import check_choice
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording, concatenated

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Identification:
    """What automatic identification found."""

    model: PolynomialModel  # in recorded units less their offsets, at the prepared rate
    choice: Choice  # the model as it was chosen, with its scores
    prepared: PreparedRecord
    decisions: tuple[Decision, ...]
    trials: tuple[Trial, ...]  # remedies of failed checks
    failed: tuple[str, ...]  # checks that stay failed

    def simulate(self, recording: Recording) -> Array:
        """Simulation of a recording from the initial state that fits it, in recorded units.

        At the prepared rate: ``recording`` is prepared as the estimation samples were, but not
        differenced.
        """
        prepared, model = self.prepared, self.choice.candidate.polynomials
        assert model is not None
        fitted, offset = self.choice.level == "state", prepared.offsets[1][0]
        if prepared.plan.differences:  # the level of the signals themselves is not known
            fitted, offset, model = True, 0.0, replace(model, level=0.0)
            zeros = np.zeros_like(prepared.offsets[0]), np.zeros_like(prepared.offsets[1])
            prepared = replace(prepared, offsets=zeros)
        parts = [
            simulated(model, each, fitted, prepared.plan.objective == "absolute")[:, 0]
            for each in prepared.of_other(recording, differences=0)
        ]
        return np.asarray(np.concatenate(parts) * prepared.scales[1][0] + offset)


def identify(
    input: ArrayLike | Sequence[ArrayLike],  # noqa: A002 - the field's word
    output: ArrayLike | Sequence[ArrayLike],
    sampling_rate: float = 1.0,
    *,
    purpose: Purpose = "auto",
    log: Callable[[str], None] | None = None,
) -> Identification:
    """Identify a system of one input and output, (N,) each: all is decided by evidence.

    On the numerics alone, without validation samples, checks and report, which
    :func:`evopem.identify` adds.  Sequences of arrays are several recordings of one system, each
    with its own initial state and level.  NaN marks missing samples.  ``sampling_rate``: Hz.
    ``purpose``: ``auto`` is simulation.  ``log`` receives the sentence of each decision.

    Raises InputError when the recordings do not fit together or are too short, or the purpose is
    not known.

    Examples
    --------
    >>> from scipy.signal import lfilter
    >>> generator = np.random.default_rng(1)
    >>> u, e = generator.standard_normal((2, 400))
    >>> y = lfilter([0.0, 1.0], [1.0, -1.5, 0.7], u) + 0.1 * e
    >>> found = identify(u, y, 10.0)
    >>> round(found.model.modes()[0].frequency_hz, 2)
    0.78
    """
    check_choice("purpose", purpose, get_args(Purpose))
    several = np.ndim(input[0]) > 0  # type: ignore[index]
    channels = zip(input, output, strict=True) if several else [(input, output)]  # type: ignore[arg-type]
    together = concatenated(
        [
            Recording(np.array(u, dtype=float), np.array(y, dtype=float), float(sampling_rate))
            for u, y in channels
        ]
    )
    decisions: list[Decision] = []

    def tell(*made: Decision) -> None:
        decisions.extend(made)
        for each in made:
            if log is not None:
                log(f"{each.subject}: {each.choice}. {each.sentence}")

    with one_blas_thread():
        plan = decide_preparation(together)
        tell(*plan.decisions)
        prepared = prepare(together, plan)
        folds = decide_folds(prepared.stretches)
        delays = decide_delays(prepared.stretches, ("input",))
        tell(folds.decision, folds.repetition.decision, delays.decision)
        scorer = Scorer(prepared.stretches, folds, prepared.settings, delays=delays.delays)
        searches: dict[str, StructureSearch] = {}
        for structure in NESTED:
            searches[structure] = search_structure(scorer, structure, searches)
            tell(searches[structure].decision)
        comparison = compare_structures(scorer, tuple(searches.values()))
        tell(*comparison.decisions)
        remedied = act_on_checks(scorer, comparison.choice(purpose))
    return Identification(
        model=prepared.in_its_units(remedied.choice.candidate.model),
        choice=remedied.choice,
        prepared=prepared,
        decisions=tuple(decisions),
        trials=remedied.trials,
        failed=remedied.failed,
    )
