"""Numbers as they are printed: a true minus sign, sensible digits, errors to two digits."""

from __future__ import annotations

import math
from typing import Any, TypeGuard

# Narrow no-break space, between a number and its unit.
THIN = "\u202f"
# No-break space, inside a number.
FIRM = "\u00a0"
MISSING = "–"


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is there and finite."""
    return isinstance(value, int | float) and math.isfinite(value)


def number(value: Any, digits: int = 4) -> str:
    """A number to so many significant digits, or a dash for none."""
    if not is_number(value):
        return MISSING
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa}{FIRM}·{FIRM}10{superscript(int(exponent))}".replace("-", "−")
    return text.replace("-", "−")


def raw(value: Any) -> str:
    """A number for machines, at full precision; nothing for none."""
    return f"{value:.12g}" if is_number(value) else ""


def superscript(power: int) -> str:
    """A power as raised digits."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def fixed(value: Any, decimals: int = 2) -> str:
    """A number with so many decimals, or a dash for none."""
    if not is_number(value):
        return MISSING
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


def percent(value: Any, digits: int = 3) -> str:
    """A percentage with its sign."""
    if not is_number(value):
        return MISSING
    if value and abs(value) < 1e-4:
        return f"{number(value, digits)}{THIN}%"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
    return f"{fixed(value, decimals)}{THIN}%"


def count(value: Any) -> str:
    """A whole number, its thousands set apart."""
    return f"{int(value):,}".replace(",", THIN) if is_number(value) else MISSING


def with_error(value: Any, error: Any) -> str:
    """A value and its standard error, the error to two digits and the value to the same place."""
    if not is_number(value):
        return MISSING
    if not is_number(error) or error <= 0:
        return number(value)
    decimals = max(0, 1 - math.floor(math.log10(error)))
    if decimals > 9:
        return f"{number(value, 6)} ± {number(error, 2)}"
    return f"{fixed(value, decimals)} ± {fixed(error, decimals)}"


def root(real: float, imaginary: float, decimals: int = 4) -> str:
    """A root of a real polynomial, a complex one with its conjugate."""
    if abs(imaginary) < 0.5 * 10.0**-decimals:
        return fixed(real, decimals)
    return f"{fixed(real, decimals)} ± {fixed(abs(imaginary), decimals)}i"


def enumeration(items: list[str]) -> str:
    """Words in a row: "a", "a and b", "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"


def plural(amount: int, singular: str, several: str = "") -> str:
    """An amount with its noun."""
    return f"{count(amount)} {singular if amount == 1 else several or singular + 's'}"
