"""Numbers as they are printed: a true minus sign, sensible digits, errors to two digits.

What is missing or not finite is printed as a dash, or as "not known" where it is a standard error.
"""

import math
from collections.abc import Sequence
from typing import TypeGuard

from evopem.models.modes import Mode
from evopem.models.parameter_covariance import NORMAL_95
from evopem.results.fleet import mode_values
from evopem.validation.checks.check import superscript, whole

THIN = "\u202f"  # narrow no-break space, between a number and its unit
FIRM = "\u00a0"  # no-break space, inside a number
MISSING = "–"
NOT_KNOWN = "not known"
# Where an error is larger than this and its value, the data do not determine the value.
LONGEST_ERROR = 1000.0


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def number(value: float | None, digits: int = 4) -> str:
    """A number with significant digits, or a dash."""
    if not is_number(value):
        return MISSING
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa}{FIRM}·{FIRM}10{superscript(int(exponent))}".replace("-", "−")
    return text.replace("-", "−")


def raw(value: float | None) -> str:
    """A number for programs, with 12 digits; empty where it is missing."""
    return f"{value:.12g}" if is_number(value) else ""


def fixed(value: float | None, decimals: int = 2) -> str:
    """A number with a fixed number of decimals, or a dash."""
    if not is_number(value):
        return MISSING
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


def percent(value: float | None, digits: int = 3) -> str:
    """A percentage with its sign, or a dash."""
    if not is_number(value):
        return MISSING
    if value and abs(value) < 1e-4:
        return f"{number(value, digits)}{THIN}%"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
    return f"{fixed(value, decimals)}{THIN}%"


def ratio(factor: float) -> str:
    """A ratio of at least 1 in words: as a percentage below 2."""
    more = percent(100.0 * (factor - 1.0), 2)
    return more if factor < 2.0 else f"a factor of {number(factor, 2)}"


def count(value: float | None) -> str:
    """A whole number with separated thousands, or a dash."""
    return whole(int(value)) if is_number(value) else MISSING


def hertz(frequency: float | None) -> str:
    """A frequency with its unit."""
    return f"{number(frequency)}{THIN}Hz"


def standard_error(error: float | None) -> str:
    """A standard error to two digits, or "not known"."""
    return number(error, 2) if is_number(error) else NOT_KNOWN


def with_error(value: float | None, error: float | None) -> str:
    """A value and its standard error, both to the second digit of the error.

    An error that is far larger than the value says that the data do not determine it.
    """
    if not is_number(value):
        return MISSING
    if not is_number(error) or error <= 0:
        return f"{number(value)} ± {standard_error(error)}"
    decimals = max(0, 1 - math.floor(math.log10(error)))
    if error > max(abs(value), LONGEST_ERROR):
        return f"{number(value, 3)} ± {NOT_KNOWN}"
    if decimals > 9:
        return f"{number(value, 6)} ± {number(error, 2)}"
    return f"{fixed(value, decimals)} ± {fixed(error, decimals)}"


def damping_limit(mode: Mode) -> float | None:
    """Upper end of the 95 % interval of a damping ratio, %, where that contains 0 and not 100; else
    None. Then the record does not tell whether the mode decays: the search's bound may set it."""
    damping, half_width = 100.0 * mode.damping_ratio, 100.0 * NORMAL_95 * mode.damping_se
    return damping + half_width if abs(damping) <= half_width < 100.0 - damping else None


def mode_cells(mode: Mode) -> tuple[str, str]:
    """Natural frequency in Hz and damping ratio in percent: with standard errors, or its limit."""
    frequency, frequency_error, damping, damping_error = mode_values(mode)
    limit = damping_limit(mode)
    shown = with_error(damping, damping_error) if limit is None else f"<{FIRM}{number(limit, 2)}"
    return with_error(frequency, frequency_error), shown


def mode_place(mode: Mode) -> str:
    """A mode by its frequency in Hz, with the limit of a damping that the record leaves open."""
    limit, place = damping_limit(mode), number(mode.frequency_hz, 3)
    return place if limit is None else f"{place} (damping below {percent(limit, 2)})"


def to_its_error(value: float | None, error: float | None, most: int = 6) -> str:
    """A value alone, to the first digit of its standard error and at most so many digits."""
    if not is_number(value) or not is_number(error) or error <= 0 or value == 0:
        return number(value, 3)
    digits = 1 + math.floor(math.log10(abs(value))) - math.floor(math.log10(error))
    decimals = math.floor(math.log10(abs(value)))
    kept = min(max(digits, 1), most)
    return fixed(value, max(0, kept - 1 - decimals)) if -4 < decimals < 6 else number(value, kept)


def enumeration(items: list[str]) -> str:
    """Items in a row: "a", "a and b", "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"


def plural(amount: int, singular: str, several: str = "") -> str:
    """An amount with its noun."""
    return f"{count(amount)} {singular if amount == 1 else several or singular + 's'}"


def aligned(rows: Sequence[Sequence[str]], gap: str = "  ") -> list[str]:
    """Rows of words as lines, their columns one below the other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        gap.join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def times(amount: int) -> str:
    """How often something is done: "not at all", "once", "twice", "3 times"."""
    return {0: "not at all", 1: "once", 2: "twice"}.get(amount, f"{amount} times")
