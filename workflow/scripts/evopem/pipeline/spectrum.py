"""Spectrum: Thomson's multitaper estimate, its peaks, and an empirical frequency response."""

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import SpectrumSettings
from evopem.files.atomic import write_table
from evopem.files.json_form import save
from evopem.models.response_tables import by_pair
from evopem.results.layout import DatasetFiles
from evopem.signals.peaks import summarize_spectrum
from evopem.signals.prepared_data import load_prepared
from evopem.signals.spectra import Spectrum, frequency_response, multitaper_spectrum

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

    def of_channels(estimates: list[Spectrum], name: str) -> Array:
        return np.stack([getattr(spectrum, name) for spectrum in estimates], axis=1)

    columns = {
        name: of_channels(spectra, name)[:, :, None] for name in ("density", "lower", "upper")
    }
    if response is not None:
        columns["input_density"] = of_channels(of_inputs, "density")[:, None]
        shown = "gain", "gain_lower", "gain_upper", "phase_deg"
        columns |= {f"frequency_response_{name}": getattr(response, name) for name in shown}
        columns["coherence"] = response.coherence[:, :, None]
    names = recording.output_names, recording.input_names
    table = by_pair(*names, "frequency_hz", spectra[0].frequencies, columns)
    if response is None:
        del table["input"]
    write_table(files.spectrum, table)
    save([summarize_spectrum(spectrum) for spectrum in spectra], files.spectrum_summary)
