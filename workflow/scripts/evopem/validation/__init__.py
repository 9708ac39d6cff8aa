"""Validation of a fitted model: residual tests, prediction, simulation, and checks in words."""

from evopem.validation.checks import Check, checks
from evopem.validation.validation import Validation, validate

__all__ = ["Check", "Validation", "checks", "validate"]
