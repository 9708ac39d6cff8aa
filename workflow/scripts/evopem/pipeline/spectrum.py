"""Spectrum: Thomson's multitaper estimate, its peaks, and an empirical frequency response."""

from __future__ import annotations

from evopem.config.settings import SpectrumSettings
from evopem.files.atomic import write_table
from evopem.files.json_form import save
from evopem.results.layout import DatasetFiles
from evopem.signals.peaks import summarize_spectrum
from evopem.signals.prepared_data import load_prepared
from evopem.signals.spectra import frequency_response, multitaper_spectrum


def estimate_spectrum(files: DatasetFiles, settings: SpectrumSettings) -> None:
    """Estimate the spectra of the estimation samples, and the frequency response they imply.

    Of several stretches, the longest one is used.
    """
    samples = load_prepared(files.prepared, files.transforms).estimation.longest
    rate, width, nfft = samples.sampling_rate, settings.time_halfbandwidth, settings.nfft
    spectrum = multitaper_spectrum(samples.output, rate, width, nfft)
    table = {
        "frequency_hz": spectrum.frequencies,
        "density": spectrum.density,
        "lower": spectrum.lower,
        "upper": spectrum.upper,
    }
    if samples.has_input:
        input_spectrum = multitaper_spectrum(samples.input, rate, width, nfft)
        response = frequency_response(samples, width, nfft)
        table |= {
            "input_density": input_spectrum.density,
            "frequency_response_gain": response.gain[:, 0, 0],
            "frequency_response_gain_lower": response.gain_lower[:, 0, 0],
            "frequency_response_gain_upper": response.gain_upper[:, 0, 0],
            "frequency_response_phase_deg": response.phase_deg[:, 0, 0],
            "coherence": response.coherence[:, 0],
        }
    write_table(files.spectrum, table)
    save(summarize_spectrum(spectrum), files.spectrum_summary)
