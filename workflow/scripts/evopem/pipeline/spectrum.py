"""Spectrum: Thomson's multitaper estimate, its peaks, and an empirical frequency response."""

from typing import Any

import numpy as np

from evopem.config.settings import SpectrumSettings
from evopem.files.atomic import write_table
from evopem.files.json_form import save
from evopem.results.layout import DatasetFiles
from evopem.signals.peaks import summarize_spectrum
from evopem.signals.prepared_data import load_prepared
from evopem.signals.spectra import frequency_response, multitaper_spectrum

# Points of the transforms where there are several pairs of channels, so that tables stay small.
MOST_OF_PAIRS = 2048


def estimate_spectrum(files: DatasetFiles, settings: SpectrumSettings) -> None:
    """Estimate the spectra of the estimation samples, and the frequency responses they imply.

    Of several stretches, the longest one is used.  A row for each frequency of each pair of output
    and input, without an input of each output.
    """
    recording = load_prepared(files.prepared, files.transforms).estimation
    samples, rate, nfft = recording.longest, recording.sampling_rate, settings.nfft
    count, width = samples.inputs.shape[1], settings.time_halfbandwidth
    if count * len(recording.output_names) > 1:
        nfft = min(nfft, MOST_OF_PAIRS)
    if count > 1:  # enough tapers for the spectral matrix of the inputs to be inverted
        width = min(max(width, 2.0 * count + 1.0), samples.samples / 4.0)
    spectra = [multitaper_spectrum(signal, rate, width, nfft) for signal in samples.outputs.T]
    of_inputs = [multitaper_spectrum(signal, rate, width, nfft) for signal in samples.inputs.T]
    response = frequency_response(samples, width, nfft) if count else None
    tables: list[dict[str, Any]] = []
    for row, spectrum in enumerate(spectra):
        first_columns = {
            "output": [recording.output_names[row]] * len(spectrum.frequencies),
            "frequency_hz": spectrum.frequencies,
            "density": spectrum.density,
            "lower": spectrum.lower,
            "upper": spectrum.upper,
        }
        if response is None:
            tables.append(first_columns)
            continue
        for column, of_input in enumerate(of_inputs):
            tables.append(
                first_columns
                | {
                    "input": [recording.input_names[column]] * len(spectrum.frequencies),
                    "input_density": of_input.density,
                    "frequency_response_gain": response.gain[:, row, column],
                    "frequency_response_gain_lower": response.gain_lower[:, row, column],
                    "frequency_response_gain_upper": response.gain_upper[:, row, column],
                    "frequency_response_phase_deg": response.phase_deg[:, row, column],
                    "coherence": response.coherence[:, row],
                }
            )
    columns = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    write_table(files.spectrum, columns)
    save([summarize_spectrum(spectrum) for spectrum in spectra], files.spectrum_summary)
