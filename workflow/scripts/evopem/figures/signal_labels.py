"""Names of the signals on axes and in sentences, before and after the transforms."""

from __future__ import annotations

from evopem.signals.prepared_data import Transforms

ORDINALS = {1: "first", 2: "second", 3: "third"}


def differences(count: int) -> str:
    """Name of a difference: "second difference"."""
    return f"{ORDINALS.get(count, f'{count}th')} difference"


def prepared_output_name(transforms: Transforms, name: str) -> str:
    """Name of the output after its transforms."""
    shown = name if transforms.box_cox is None else f"Box-Cox transformed {name}"
    return f"{differences(transforms.difference)} of {shown}" if transforms.difference else shown


def prepared_output_unit(transforms: Transforms, unit: str) -> str:
    """Unit of the output after its transforms; empty after a power transform."""
    return unit if transforms.box_cox is None else ""


def prepared_input_name(transforms: Transforms, name: str) -> str:
    """Name of the input after its transforms."""
    count = transforms.difference_input
    return f"{differences(count)} of {name}" if count else name
