"""Estimate the multitaper spectrum of the prepared output, and the response it implies."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from evopem.files.atomic import write_json, write_table
from evopem.files.job import job
from evopem.signals.preparation import load_prepared
from evopem.signals.spectral.multitaper import (
    multitaper_frequency_response,
    multitaper_spectrum,
    resonance_count,
    spectral_peaks,
)

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(
    prepared_files: tuple[str, str], settings: dict[str, Any], spectrum_file: str, peaks_file: str
) -> None:
    samples = load_prepared(*prepared_files).estimation
    rate = samples.sampling_rate
    spectrum = multitaper_spectrum(samples.output, rate, **settings)
    input_spectrum = multitaper_spectrum(samples.input, rate, **settings)
    response = multitaper_frequency_response(samples.input, samples.output, rate, **settings)
    table = {
        "frequency_hz": spectrum.frequencies,
        "density": spectrum.density,
        "lower": spectrum.lower,
        "upper": spectrum.upper,
        "input_density": input_spectrum.density,
        "frequency_response_gain": response.gain,
        "frequency_response_gain_lower": response.gain_lower,
        "frequency_response_gain_upper": response.gain_upper,
        "frequency_response_phase_deg": response.phase_deg,
        "coherence": response.coherence,
    }
    write_table(spectrum_file, table)
    peaks = spectral_peaks(spectrum)
    summary = {
        "time_halfbandwidth": spectrum.time_halfbandwidth,
        "tapers": spectrum.tapers,
        "nfft": spectrum.nfft,
        "segments": spectrum.segments,
        "resolution_hz": spectrum.resolution_hz,
        "peaks": [asdict(peak) for peak in peaks],
        "resonances": resonance_count(peaks),
    }
    write_json(peaks_file, summary)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            (snakemake.input.prepared, snakemake.input.transforms),
            snakemake.params.spectrum,
            snakemake.output.spectrum,
            snakemake.output.peaks,
        )
