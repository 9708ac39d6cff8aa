"""Names of the signals as they stand on axes and in sentences, before and after transforms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ORDINALS = {1: "first", 2: "second", 3: "third"}


def differences(count: int) -> str:
    """Name of a difference: "second difference"."""
    return f"{ORDINALS.get(count, f'{count}th')} difference"


def prepared_output_name(transforms: Mapping[str, Any], name: str) -> str:
    """Name of the output after its transforms."""
    shown = f"Box-Cox transformed {name}" if transforms.get("box_cox") is not None else name
    count = int(transforms.get("difference") or 0)
    return f"{differences(count)} of {shown}" if count else shown


def prepared_output_unit(transforms: Mapping[str, Any], unit: str) -> str:
    """Unit of the output after its transforms; a power transform leaves none."""
    return "" if transforms.get("box_cox") is not None else unit


def prepared_input_name(transforms: Mapping[str, Any], name: str) -> str:
    """Name of the input after its transforms."""
    count = int(transforms.get("difference_input") or 0)
    return f"{differences(count)} of {name}" if count else name
