"""What other stages read of a spectrum, apart from how it is estimated."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpectralPeak:
    """A local maximum of the density that noise alone does not explain."""

    frequency_hz: float
    density: float  # density at the peak and its 95 % band (unit² / Hz)
    prominence_db: float  # height above the higher of the two valleys between it and higher maxima
    lower: float  # density at the peak and its 95 % band (unit² / Hz)
    upper: float


@dataclass(frozen=True)
class SpectrumSummary:
    """What the order search and the report need of a spectrum."""

    time_halfbandwidth: float
    tapers: int
    nfft: int
    segments: int
    resolution_hz: float
    peaks: tuple[SpectralPeak, ...]
    resonances: int  # peaks that may be resonances; 0 where they are the lines of a periodic input
