"""Refuse keys and values that the schema does not allow."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jsonschema
import yaml

from evopem.config.strict_yaml import Keys
from evopem.errors import InputError


def schema_file() -> Path:
    """The JSON schema of the configuration, as YAML.

    It is in a subpackage of an installed evopem, and in ``workflow/schemas`` in a checkout.
    """
    package = Path(__file__).resolve().parents[1]
    installed = package / "schemas"
    folder = installed if installed.is_dir() else package.parents[1] / "schemas"
    return folder / "config.schema.yaml"


def _full_pattern(
    _validator: Any, pattern: str, instance: object, _: Keys
) -> Iterator[jsonschema.ValidationError]:
    """Compare a whole text with a pattern, where ``$`` would accept a line break at its end."""
    whole = pattern.replace("$", r"\Z")
    if isinstance(instance, str) and not re.search(whole, instance):
        yield jsonschema.ValidationError(f"{instance!r} does not match {pattern!r}")


_Validator = jsonschema.validators.extend(
    jsonschema.Draft202012Validator, {"pattern": _full_pattern}
)


def check_schema(config: Keys, schema: Keys, source: str = "config.yaml") -> None:
    """Refuse a configuration with a key or a value the schema does not know.

    Parameters
    ----------
    config : mapping
        The configuration as the user wrote it.
    schema : mapping
        Its JSON schema. The `description` of a value ends the error's sentence.
    source : str
        What the configuration is called in an error.

    Raises
    ------
    InputError
        Naming the path of the key (``datasets.arm.delay.orders``), its value, what is wrong with
        it and what to do.
    """
    errors = _Validator(schema).iter_errors(config)
    error = min(errors, key=lambda each: (len(each.path), key_path(each.path)), default=None)
    if error is None:
        return
    if error.validator == "additionalProperties":
        known = list(error.schema["properties"])
        unknown = next(key for key in error.instance if key not in known)
        problem = f"there is no such key{_nearest(str(unknown), known)}"
        remedy = f"use one of {', '.join(known)}"
        raise InputError(source, problem, remedy, key_path((*error.path, unknown)))
    raise InputError(source, *_explained(error), key_path(error.path))


def key_path(parts: Iterable[str | int]) -> str:
    """Join the steps to a value, as in ``datasets.arm.delay.orders[0]``."""
    path = ""
    for part in parts:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else str(part)
    return path


def _shown(value: object) -> str:
    """Show a value as YAML would, cut when it is long."""
    text = yaml.safe_dump(_plain(value), default_flow_style=True, width=10_000).strip()
    text = text.removesuffix("\n...").strip()
    return text if len(text) <= 60 else f"{text[:57]}..."


def _plain(value: object) -> object:
    """Turn the mappings of any type that Snakemake hands over into dicts."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def _explained(error: jsonschema.ValidationError) -> tuple[str, str]:
    """Turn a validator's finding into a problem and a remedy."""
    schema, limit = error.schema, error.validator_value
    remedy = f"give {schema.get('description', 'a value of the right kind')}"
    value = _shown(error.instance)
    match error.validator:
        case "required":
            missing = next(key for key in limit if key not in error.instance)
            return f"the key {missing} is missing", "add it"
        case "type":
            problem = "there is no value" if error.instance is None else f"{value} cannot be used"
            if isinstance(error.instance, str) and _is_number(error.instance):
                remedy += f" (YAML reads {error.instance} as text)"
        case "enum":
            problem = f"{value} is not known{_nearest(error.instance, limit)}"
        case "pattern":
            known = limit.strip("^$()").split("|")
            problem = f"{value} is not known{_nearest(error.instance, known)}"
        case "minimum":
            problem = f"{value} is below {limit}"
        case "exclusiveMinimum":
            problem = f"{value} is not above {limit}"
        case "maximum":
            problem = f"{value} is above {limit}"
        case "exclusiveMaximum":
            problem = f"{value} is not below {limit}"
        case "minItems" | "maxItems":
            count = len(error.instance)
            problem = f"{value} holds {count} value{'s' * (count != 1)}"
        case _:  # minLength, minProperties
            problem = "there is nothing in it"
    return problem, remedy


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


# Earlier names of keys and values, whose new ones resemble them too little to be guessed.
_RENAMED = {
    "stationarity": "transforms",
    "delays": "nk",
    "common": "joint",
    "c": "nc",
    "b": "nb",
    "start": "initialization",
    "chapter": "arx",
    "grown": "incremental_order",
    "mutate": "refine",
    "burn_in": "n_initial_discard",
    "share": "shard",
}


def _nearest(word: str, known: Iterable[str]) -> str:
    known = list(known)
    if _RENAMED.get(word) in known:
        return f" (did you mean {_RENAMED[word]}?)"
    lowered = {each.lower(): each for each in known}
    close = difflib.get_close_matches(word.lower(), lowered, n=1)
    return f" (did you mean {lowered[close[0]]}?)" if close else ""
