"""Synthetic recordings with a known truth."""

from __future__ import annotations

from typing import get_args

from evopem.config.channels import Synthesis, SyntheticSource
from evopem.config.settings import TransformSettings
from evopem.errors import InputError, check_choice
from evopem.signals.recording import Recording
from evopem.synthesis.armax import Truth


def synthesize(source: SyntheticSource, transforms: TransformSettings) -> tuple[Recording, Truth]:
    """Simulate a recording of a known system.

    An ARMAX recording is made non-stationary in the way that the transforms undo.

    >>> source = SyntheticSource("armax", seed=1, samples=1000)
    >>> recording, truth = synthesize(source, TransformSettings(box_cox="none", difference=0))
    >>> recording.output.shape
    (1000,)
    """
    check_choice("synthesis", source.synthesis, get_args(Synthesis))
    box_cox = transforms.box_cox
    if isinstance(box_cox, str) and box_cox not in ("auto", "none"):
        raise InputError(
            "transforms.box_cox",
            f"{box_cox!r} is not a Box-Cox parameter",
            'give a number, "auto" or "none"',
        )
    if source.synthesis == "flexible_arm":
        from evopem.synthesis.flexible_arm import flexible_arm

        return flexible_arm(source.seed, source.samples, source.sampling_rate)
    from evopem.synthesis.armax import armax

    return armax(
        source.seed,
        source.samples,
        source.sampling_rate,
        noise=0.1 if source.noise is None else source.noise,
        box_cox=None if isinstance(box_cox, str) else box_cox,
        difference=transforms.difference,
    )
