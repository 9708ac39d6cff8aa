"""The initial inputs of the fuzzer, and the inputs it found, read once each."""

from pathlib import Path

import numpy as np
import pytest

from .targets import read_bytes, seeds

SEEDS = seeds()
CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())


@pytest.mark.parametrize("name", [name for name in SEEDS if name.endswith("-0")])
def test_the_seed_of_each_format_is_a_recording(name, tmp_path):
    assert read_bytes(SEEDS[name], tmp_path)


@pytest.mark.parametrize("file", CORPUS, ids=lambda file: file.name)
def test_what_the_fuzzer_found_is_read_or_refused(file, tmp_path):
    read_bytes(file.read_bytes(), tmp_path)


@pytest.mark.parametrize("name", [name for name in SEEDS if name.endswith("-0")])
def test_damaged_seeds_are_read_or_refused(name, tmp_path):
    """Each initial input with bytes changed, removed or repeated, with a fixed random seed."""
    generator = np.random.default_rng(len(name))
    for _ in range(40):
        data = bytearray(SEEDS[name])
        for _ in range(generator.integers(1, 6)):
            start = int(generator.integers(2, len(data)))
            length = int(generator.integers(1, 40))
            match generator.integers(4):
                case 0:
                    data[start] = int(generator.integers(256))
                case 1:
                    del data[start : start + length]
                case 2:
                    data[start:start] = data[start : start + length]
                case 3:
                    data[start : start + length] = bytes(length)
            if len(data) < 4:
                break
        read_bytes(bytes(data), tmp_path)
