"""What rules ask about the search over orders by the recipe of the chapter."""

from __future__ import annotations

from dataclasses import dataclass, replace

from evopem.config import order_grid
from evopem.config.order_grid import phases_of_dataset
from evopem.config.settings import OrderGrid
from evopem.files.json_form import to_json
from evopem.pipeline.constraint_plan import known_rate
from evopem.pipeline.planning.wildcards import FILES, SingleChannel, Wildcards


@dataclass(frozen=True)
class OrderSearch(SingleChannel):
    """The phases of a search over orders: their parts of the grid, and their files."""

    def phases(self, wildcards: Wildcards) -> list[str]:
        """Names of the phases of a data set, in their order."""
        return list(phases_of_dataset(self._of(wildcards)))

    def selections(self, wildcards: Wildcards) -> list[str]:
        """The outputs of all phases of a data set."""
        return [FILES.phase(phase) for phase in self.phases(wildcards)]

    def last_selection(self, wildcards: Wildcards) -> str:
        """The output of the last phase of a data set."""
        return self.selections(wildcards)[-1]

    def phase_of_orders(self, wildcards: Wildcards) -> str:
        """The phase over whose models the modes are compared."""
        return order_grid.phase_of_orders_of(self._of(wildcards))

    def models_of_orders(self, wildcards: Wildcards) -> str:
        """The output of that phase."""
        return FILES.phase(self.phase_of_orders(wildcards))

    def part_count(self, wildcards: Wildcards) -> int:
        """The number of jobs of a phase."""
        grid, per_job = self._of(wildcards).order_grid, self.config.run.candidates_per_job
        return order_grid.part_count(wildcards.phase, grid, per_job)

    def parts(self, wildcards: Wildcards) -> list[str]:
        """The outputs of all jobs of a phase."""
        numbers = range(1, self.part_count(wildcards) + 1)
        return [FILES.part(wildcards.phase, number) for number in numbers]

    def earlier_results(self, wildcards: Wildcards) -> dict[str, str]:
        """What a phase waits for: its predecessor's selection, and the spectrum if it counts."""
        structure = self._of(wildcards).order_grid.structure
        previous = order_grid.previous_phase(wildcards.phase, structure)
        inputs = {"previous": FILES.phase(previous)} if previous else {}
        if order_grid.needs_resonances(wildcards.phase, self._of(wildcards).order_grid):
            inputs["spectrum"] = FILES.spectrum_summary
        return inputs

    def phase_grid(self, wildcards: Wildcards) -> object:
        """The part of the order grid that a phase uses."""
        grid = order_grid.grid_of_phase(wildcards.phase, self._of(wildcards).order_grid)
        return to_json(grid)

    def selection_grid(self, wildcards: Wildcards) -> object:
        """The part of the order grid that the selection of a phase uses: the delays, at its end."""
        grid = self._of(wildcards).order_grid
        refined = wildcards.phase == order_grid.DELAY_REFINED_IN
        own = OrderGrid(structure=grid.structure, level=grid.level)
        return to_json(replace(own, delay=grid.delay) if refined else own)

    def window(self, wildcards: Wildcards) -> object:
        """The samples on which the candidates of a data set are compared.

        None for the automatic recipe, whose chosen model has its own.
        """
        if self._of(wildcards).automatic is not None:
            return None
        return to_json(order_grid.scoring_window(self._of(wildcards)))

    def requirements(self, wildcards: Wildcards) -> object:
        """What a record must have for the largest candidate of its data set."""
        return to_json(order_grid.sample_requirements(self._of(wildcards)))

    def fit_to_check(self, wildcards: Wildcards) -> object:
        """Constraints and order grid, where constraints in Hz wait for the sampling rate."""
        settings = self._of(wildcards)
        waits = settings.fit.constraints is not None and known_rate(settings) is None
        return to_json((settings.fit, settings.order_grid)) if waits else None
