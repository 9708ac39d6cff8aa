"""What rules ask about the automatic recipe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from evopem.config import order_grid
from evopem.config.settings import AutomaticSettings
from evopem.config.structures import AUTOMATIC_STRUCTURES, searched_structures
from evopem.files.json_form import to_json
from evopem.pipeline.planning.wildcards import FILES, SingleChannel, Wildcards
from evopem.results.layout import DatasetFiles

_DECISIONS = ("preparation", "folds", "delay", "comparison", "remedies")


@dataclass(frozen=True)
class AutomaticRecipe(SingleChannel):
    """The decisions of the automatic recipe: what they are given, and their files."""

    def files_of(self, dataset: str, own: DatasetFiles) -> list[str]:
        """All files of decisions of one data set, by the paths of its results."""
        searches = [own.search(each) for each in self._structures(dataset)]
        other = self._other_purpose(dataset)
        others = [own.other_errors(other), own.other_model(other)]
        return [own.stretches, *map(own.decision, _DECISIONS), *searches, *others, own.decisions]

    def given_preparation(self, wildcards: Wildcards) -> dict[str, Any]:
        """What the configuration decides of an automatic preparation."""
        settings = self._of(wildcards)
        automatic = settings.automatic or AutomaticSettings()
        return order_grid.given_preparation(settings.preparation, automatic)

    def settings(self, *names: str) -> Callable[[Wildcards], dict[str, Any]]:
        """A function that gives some settings of the automatic recipe, the others built in."""

        def provide(wildcards: Wildcards) -> dict[str, Any]:
            own: dict[str, Any] = to_json(self._of(wildcards).automatic)
            return {name: own[name] for name in names}

        return provide

    def structures(self, wildcards: Wildcards) -> list[str]:
        """The structures that the automatic recipe searches."""
        return list(self._structures(wildcards.dataset))

    def wanted_structures(self, wildcards: Wildcards) -> list[str]:
        """The structures among which the automatic recipe chooses."""
        automatic = self._of(wildcards).automatic
        structure = automatic.structure if automatic else None
        return [structure] if structure else list(self._structures(wildcards.dataset))

    def searches(self, wildcards: Wildcards) -> list[str]:
        """The outputs of the searches of all structures."""
        return [FILES.search(each) for each in self.structures(wildcards)]

    def wanted_searches(self, wildcards: Wildcards) -> list[str]:
        """The outputs of the searches of these structures."""
        return [FILES.search(each) for each in self.wanted_structures(wildcards)]

    def nested_searches(self, wildcards: Wildcards) -> list[str]:
        """The outputs of the searches whose optima a structure's search starts from."""
        nested = AUTOMATIC_STRUCTURES[str(wildcards.get("structure"))]
        return [FILES.search(each) for each in nested]

    def other_purpose(self, wildcards: Wildcards) -> str:
        """The other purpose for which the automatic recipe keeps a model."""
        return self._other_purpose(wildcards.dataset)

    def other_errors(self, wildcards: Wildcards) -> str:
        """What the model for this purpose reaches."""
        return FILES.other_errors(self.other_purpose(wildcards))

    def chosen(self, wildcards: Wildcards) -> dict[str, str]:
        """What the completed model of an automatic recipe is described by."""
        if self._of(wildcards).automatic is None:
            return {}
        return {"plan": FILES.decision("preparation"), "remedies": FILES.decision("remedies")}

    def decisions(self, wildcards: Wildcards) -> dict[str, str]:
        """The decisions of an automatic recipe, for its report."""
        if self._of(wildcards).automatic is None:
            return {}
        return {"decisions": FILES.decisions}

    def _other_purpose(self, dataset: str) -> str:
        automatic = self.config.single_channel[dataset].automatic or AutomaticSettings()
        return automatic.other_purpose

    def _structures(self, dataset: str) -> tuple[str, ...]:
        automatic = self.config.single_channel[dataset].automatic
        return searched_structures(automatic.structure if automatic else None)
