"""Synthetic recordings with a known truth."""

from evopem.config.channels import SyntheticSource
from evopem.config.settings import TransformSettings
from evopem.signals.recording import Recording
from evopem.synthesis.armax import Truth, armax


def synthesize(source: SyntheticSource, transforms: TransformSettings) -> tuple[Recording, Truth]:
    """Simulate a recording of a known system.

    An ARMAX recording is made non-stationary in the way that the transforms undo.

    >>> source = SyntheticSource("armax", seed=1, samples=1000)
    >>> recording, truth = synthesize(source, TransformSettings(box_cox="none", difference=0))
    >>> recording.output.shape
    (1000,)
    """
    length = source.seed, source.samples, source.sampling_rate
    if source.synthesis == "flexible_arm":
        from evopem.synthesis.flexible_arm import flexible_arm

        return flexible_arm(*length, source.softening or 0.0)
    noise = 0.1 if source.noise is None else source.noise
    box_cox = None if isinstance(transforms.box_cox, str) else transforms.box_cox
    return armax(*length, noise, box_cox, transforms.difference)
