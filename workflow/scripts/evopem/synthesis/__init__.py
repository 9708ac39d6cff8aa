"""Synthetic recordings with a known truth."""

from __future__ import annotations

from evopem.config.settings import SyntheticSource, TransformSettings
from evopem.signals.recording import Recording
from evopem.synthesis.truth import Truth


def synthesize(source: SyntheticSource, transforms: TransformSettings) -> tuple[Recording, Truth]:
    """Simulate a recording of a known system.

    Parameters
    ----------
    source : SyntheticSource
    transforms : TransformSettings
        An ARMAX recording is made non-stationary in the way that these transforms undo.

    Examples
    --------
    >>> source = SyntheticSource("armax", seed=1, samples=1000)
    >>> recording, truth = synthesize(source, TransformSettings(box_cox="none", difference=0))
    >>> recording.output.shape
    (1000,)
    """
    if source.synthesis == "flexible_arm":
        from evopem.synthesis.flexible_arm import flexible_arm

        return flexible_arm(source.seed, source.samples, source.sampling_rate)
    from evopem.synthesis.armax import armax

    box_cox = transforms.box_cox
    return armax(
        source.seed,
        source.samples,
        source.sampling_rate,
        noise=0.1 if source.noise is None else source.noise,
        box_cox=None if isinstance(box_cox, str) else box_cox,
        difference=transforms.difference,
    )
