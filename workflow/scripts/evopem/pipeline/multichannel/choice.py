"""The choice of form, weighting and order."""

from __future__ import annotations

from evopem.automatic.state_space_choice import choose
from evopem.automatic.variant_search import Variant, VariantSearch
from evopem.config.settings import AutomaticSettings
from evopem.files.json_form import load, save
from evopem.results.layout import DatasetFiles


def choose_state_space(
    files: DatasetFiles, variants: tuple[Variant, ...], choices: AutomaticSettings
) -> None:
    """Choose form, weighting and order by the errors on held-out samples."""
    searches = [load(VariantSearch, files.search(variant.name)) for variant in variants]
    save(choose(searches, choices), files.decision("comparison"))
