"""Estimates that show, plot, compare, report and save themselves as identifications do."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from evopem.errors import FOR_RESULTS, InputError, check_packages
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.results.layout import FIGURES

if TYPE_CHECKING:
    from evopem.notebook.results import Results

OF_RESULTS = (
    *("results", "summary", "validation", "checks", "verdict", "uses", "modes", "shapes"),
    *("simulation_error_percent", "prediction_error_percent", "compare", "report", "save"),
    *(f"plot_{name}" for name in (*FIGURES, "step_response", "impulse_response")),
)
OF_MODEL = ("simulate", "predict")


@dataclass(frozen=True, eq=False, repr=False)
class EstimateResults:
    """The attributes of :class:`Results`, which are made when one of them is first asked for.

    No sample was held out: the samples of the estimate judge it as well, and its checks say so.
    """

    # What :func:`.results_of_estimate` takes beside the estimate.
    asked: tuple[Any, ...] = field(kw_only=True)
    if TYPE_CHECKING:
        model: Any

        def __getattr__(self, name: str) -> Any: ...  # of those above

    @cached_property
    def shown(self) -> Results:
        """The results, as those of :func:`evopem.identify`."""
        check_packages(FOR_RESULTS, "estimate", "the tables of the results")
        return self._results()

    def _results(self) -> Results:
        from evopem.notebook.identify import results_of_estimate

        return results_of_estimate(self, *self.asked)  # type: ignore[arg-type]

    def __getstate__(self) -> object:
        return {name: value for name, value in vars(self).items() if name != "shown"}

    def __repr__(self) -> str:
        try:
            return repr(self.shown)
        except (InputError, ValueError) as error:  # a package is missing, or samples
            return f"{self.model}\n{error}"

    def _repr_html_(self) -> str:
        return self.shown._repr_html_()


def _of(name: str, source: str) -> property:
    doc = f"As of {'the model' if source == 'model' else ':class:`evopem.Results`'}."
    return property(lambda self: getattr(getattr(self, source), name), doc=doc)


for _source, _names in (("shown", OF_RESULTS), ("model", OF_MODEL)):
    for _name in _names:
        setattr(EstimateResults, _name, _of(_name, _source))


@dataclass(frozen=True, eq=False, repr=False)
class PolynomialResults(EstimateResults, PolynomialEstimate):
    """An estimated polynomial model that summarizes, plots, compares and reports itself."""
