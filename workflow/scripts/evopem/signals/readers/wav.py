"""Sound files (RIFF WAVE), read by scipy."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import scipy  # whose parts load on first use

from evopem.signals.readers.open_file import Channel, Contents, refusing_damage


@contextmanager
def opened(path: Path) -> Iterator[Contents]:
    """The channels of a file by their numbers, in the counts or floats that it stores.

    Samples of 24 bits are counts of 32.
    """
    with refusing_damage(path, "WAV file"), warnings.catch_warnings():
        warnings.simplefilter("error", scipy.io.wavfile.WavFileWarning)  # of an end that is missing
        warnings.filterwarnings("ignore", "Chunk", scipy.io.wavfile.WavFileWarning)
        rate, values = scipy.io.wavfile.read(path)
    columns = np.asarray(values).reshape(len(values), -1)

    def load(index: int) -> Channel:
        return Channel("", columns[:, index], "", float(rate) if rate > 0 else None)

    yield Contents(path, "channel", [("",)] * columns.shape[1], load)
