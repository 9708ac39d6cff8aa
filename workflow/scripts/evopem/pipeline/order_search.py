"""Order search: the candidates of a phase, and the selection of one of them."""

from dataclasses import replace

from evopem.config import order_grid
from evopem.config.settings import OrderGrid, ScoringWindow, SearchSettings
from evopem.estimation.order_candidate import Candidate, PhaseSelection, first_pass
from evopem.estimation.order_selection import OrderSearch, estimate_in_parallel
from evopem.estimation.order_selection import select_candidate as select
from evopem.estimation.search.problem import Log
from evopem.files.json_form import load, save
from evopem.models.orders import orders_of
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.signals.spectrum_summary import SpectrumSummary


def estimate_candidates(
    files: DatasetFiles,
    phase: str,
    part: int,
    parts: int,
    grid: OrderGrid,
    search: SearchSettings,
    window: ScoringWindow,
    log: Log | None = None,
    cores: int = 1,
) -> None:
    """Estimate every ``parts``-th candidate of a phase, from the ``part``-th on (from 1).

    Where candidates may be pruned this is a first pass: which of them are searched further is
    known only when all of the phase are there.  Those of the phase before are taken from there.
    """
    previous = order_grid.previous_phase(phase, grid.structure)
    before = load(PhaseSelection, files.phase(previous)) if previous else None
    resonances = (
        load(tuple[SpectrumSummary, ...], files.spectrum_summary)[0].resonances
        if order_grid.needs_resonances(phase, grid)
        else None
    )
    orders = order_grid.candidate_orders(
        phase, grid, before.orders.single._asdict() if before else None, resonances
    )
    of_part = [orders_of(grid.structure, order) for order in orders[part - 1 :: parts]]
    data = load_prepared(files.prepared, files.transforms).estimation
    search = first_pass(search) if search.prune else search
    known = {} if before is None else {c.orders: c for c in before.candidates}
    new = [orders for orders in of_part if orders not in known]
    given = OrderSearch(data, search, window, grid.level, log)
    estimated = estimate_in_parallel(given, new, phase, cores)
    known |= {candidate.orders: candidate for candidate in estimated}
    candidates = [replace(known[orders], phase=phase, pruned="") for orders in of_part]
    save(candidates, files.part(phase, part))


def select_candidate(
    files: DatasetFiles,
    phase: str,
    parts: int,
    grid: OrderGrid,
    search: SearchSettings,
    window: ScoringWindow,
    log: Log | None = None,
) -> None:
    """Collect the candidates of a phase, search those that may win, and select one candidate.

    The phase of nb also compares its selection with other lags of B.
    """
    candidates = [
        candidate
        for part in range(1, parts + 1)
        for candidate in load(tuple[Candidate, ...], files.part(phase, part))
    ]
    data = load_prepared(files.prepared, files.transforms).estimation
    min_delay = order_grid.range_of(grid, "nk")[0] if phase == order_grid.DELAY_REFINED_IN else None
    given = OrderSearch(data, search, window, grid.level, log)
    selection = select(given, candidates, phase, min_delay)
    if log is not None:
        log(selection.reason)
    save(selection, files.phase(phase))
