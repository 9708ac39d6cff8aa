"""What reports say of random recordings, in short; ``benchmarks/calibration.py`` runs many more."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

import calibration

# Recordings of seconds each: all kinds of structures and inputs, with delays and faults.
CASES = ()


@pytest.fixture(scope="module")
def lines():
    return [calibration.run(number) for number in CASES]


@pytest.fixture(scope="module")
def linear(lines):
    return [line for line in lines if not line["outside"]]


def test_every_recording_gives_a_model(lines):
    assert [line.get("fault") or line.get("refused") for line in lines] == [None] * len(CASES)


def test_delays_are_found(linear):
    off = [abs(delay - line["delay"]) for line in linear for delay in line["delays"]]
    assert len([each for each in off if each > 2]) <= 0


def test_trusted_modes_are_modes_of_the_system(linear):
    assert sum(line["modes"]["trusted"] for line in linear) >= 0
    assert sum(line["modes"]["false"] for line in linear) <= 0


def test_visible_modes_are_trusted(linear):
    visible = sum(line["modes"]["visible"] for line in linear)
    assert sum(line["modes"]["missed"] for line in linear) <= 0.1 * visible


def test_responses_come_near_to_those_of_the_true_orders(linear):
    ratios = [line["response_error"] / line["oracle"] for line in linear if "oracle" in line]
    assert sum(ratio <= 1.5 for ratio in ratios) >= 0.8 * len(ratios)


def test_good_responses_are_near_the_truth(linear):
    good = [line for line in linear if line["verdict"]["response"] == "good"]
    assert good
    assert all(line["response_error"] < 0.3 for line in good)
