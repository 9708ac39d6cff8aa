"""State-space estimates that show and draw themselves, also those of frequency responses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evopem.config.strict_yaml import Keys
from evopem.estimation import frequency_fit
from evopem.estimation.frequency_fit import MOST_MODES, ResponseFit
from evopem.estimation.state_space import estimate
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate
from evopem.files.atomic import save_arrays
from evopem.notebook.estimate_results import EstimateResults
from evopem.signals.readers.frequency_responses import FrequencyResponses
from evopem.signals.recording import Recording

if TYPE_CHECKING:
    from evopem.notebook.results import Results


@dataclass(frozen=True, eq=False, repr=False)
class StateSpaceResults(EstimateResults, StateSpaceEstimate):
    """An estimated state-space model that summarizes, plots, compares and reports itself."""


@wraps(estimate.estimates_of_orders)
def estimates_of_orders(
    recording: Recording, orders: Sequence[int], **options: Any
) -> Iterator[StateSpaceResults]:
    built_in = {"structure": "ss", "level": True, "settings": None, "weighting": "determinant"}
    *asked, weighting = (options.get(name, value) for name, value in built_in.items())
    for of_order in estimate.estimates_of_orders(recording, orders, **options):
        yield StateSpaceResults(**vars(of_order), asked=(recording, *asked, None, weighting))


@dataclass(frozen=True, eq=False, repr=False)
class ResponseResults(EstimateResults, ResponseFit):
    """A model of frequency responses that summarizes, plots, compares and reports itself."""

    def _results(self) -> Results:
        from evopem.config.defaults import complete
        from evopem.notebook.results import Results
        from evopem.pipeline.frequency_responses import write_results
        from evopem.results.dataset import read_results
        from evopem.results.layout import DatasetFiles

        given, (fewest, most, seed) = self.responses, self.asked
        folder = TemporaryDirectory(prefix="evopem-", ignore_cleanup_errors=True)
        file = Path(folder.name) / "data.npz"
        columns: dict[str, NDArray] = {"frequency": given.frequencies}
        for k, j in np.ndindex(given.values.shape[1:]):
            name = f"{given.output_names[k]}/{given.input_names[j]}"
            columns[name] = given.values[:, k, j]
            if given.variances is not None:
                columns[f"{name} variance"] = self.variance_factor * given.variances[:, k, j]
        save_arrays(file, columns)
        keys: Keys = {
            "file": file.name,
            "frequency": "frequency",
            "sampling_rate": given.sampling_rate,
            "orders": {"nx": [2 * fewest, 2 * most]},
            "search": {"seed": seed},
        }
        for role in ("input", "output"):
            units = list(getattr(given, f"{role}_units"))
            keys[role] = list(getattr(given, f"{role}_names"))
            keys[f"{role}_unit"] = units if any(units) else None
        keys = {key: value for key, value in keys.items() if value is not None}
        settings = complete({"datasets": {"data": keys}}, "fit_responses").datasets["data"]
        files = DatasetFiles(f"{folder.name}/results/data")
        write_results(files, settings, self, most, file)
        return Results(files, read_results(files), folder)


def fit_responses(
    responses: FrequencyResponses,
    modes: tuple[int, int] = (1, MOST_MODES),
    seed: int = 1,
    log: Callable[[str], None] | None = None,
) -> ResponseResults:
    """Fit the output-error model of measured frequency responses with the smallest BIC.

    Of discrete time where they have a sampling rate, else of continuous time. Errors are weighed by
    their variances; a factor of them is estimated where coherences alone are known, and where
    nothing is, a variance of each response. ``modes``: fewest and most. ``log`` receives a line for
    each number of modes. InputError where there are too few frequencies.

    Shown, the fit is a summary; it plots, compares, reports and saves itself as what
    :func:`evopem.identify` returns.
    """
    fit = frequency_fit.fit_responses(responses, modes, seed, log)
    known = {part.name: getattr(fit, part.name) for part in fields(fit)}
    return ResponseResults(**known, asked=(*modes, seed))
