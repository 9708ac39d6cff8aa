"""What rules ask about data sets with several channels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from evopem.config.configuration import Configuration
from evopem.config.state_space_settings import MultichannelDataset, searched_variants, variant_name
from evopem.files.json_form import to_json
from evopem.pipeline.planning.wildcards import FILES, Wildcards


def other_purposes(dataset: MultichannelDataset) -> tuple[str, ...]:
    """The purpose whose model is kept beside that of the configuration; none without inputs."""
    if not dataset.source.channels.inputs:
        return ()
    return ("simulation" if dataset.choices.purpose == "prediction" else "prediction",)


@dataclass(frozen=True)
class SeveralChannels:
    """The searches over several channels: their orders, and their files."""

    config: Configuration

    def searched_variants(self, wildcards: Wildcards) -> list[tuple[str, str]]:
        """The forms with their weightings that a data set with several channels searches."""
        return list(searched_variants(self.config.multichannel[wildcards.dataset]))

    def order_ranges(self, wildcards: Wildcards) -> Any:
        """Ranges of the orders of the variant that a job searches."""
        choices = self.config.multichannel[wildcards.dataset].choices
        return to_json(choices.orders.of_form(wildcards.get("variant") or ""))

    def variant_searches(self, wildcards: Wildcards) -> list[str]:
        """The outputs of their searches."""
        return [FILES.search(variant_name(*each)) for each in self.searched_variants(wildcards)]

    def models_of_orders(self, wildcards: Wildcards) -> list[str]:
        """The models of all orders that these searches leave."""
        names = [variant_name(*each) for each in self.searched_variants(wildcards)]
        return [FILES.models_of_orders(name) for name in names]

    def other_state_space(self, wildcards: Wildcards) -> list[str]:
        """What the model for the other purpose reaches; nothing without inputs."""
        own = self.config.multichannel[wildcards.dataset]
        return [FILES.other_errors(purpose) for purpose in other_purposes(own)]

    def start_and_rate_given(self, wildcards: Wildcards) -> tuple[bool, bool]:
        """Whether the configuration says where samples begin, and at which rate."""
        own = self.config.multichannel[wildcards.dataset]
        return bool(own.split.discard), own.rate_given
