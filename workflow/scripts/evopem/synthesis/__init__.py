"""Synthetic recordings with a known truth."""

from __future__ import annotations

from typing import Any

from evopem.signals.recording import Recording

KINDS = ("flexible_arm", "armax")


def synthesize(kind: str, **settings: Any) -> tuple[Recording, dict[str, Any]]:
    """A synthetic recording and its truth.

    Parameters
    ----------
    kind : {"flexible_arm", "armax"}
    **settings
        Of :func:`evopem.synthesis.flexible_arm.flexible_arm` or
        :func:`evopem.synthesis.armax.armax`.
    """
    if kind == "flexible_arm":
        from evopem.synthesis.flexible_arm import flexible_arm

        return flexible_arm(**settings)
    if kind == "armax":
        from evopem.synthesis.armax import armax

        return armax(**settings)
    raise ValueError(f"synthesis must be one of {KINDS}, not {kind!r}")
