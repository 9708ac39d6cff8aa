"""What reports say of random recordings, in short; ``benchmarks/calibration.py`` runs many more."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

import calibration
from random_systems import draw_case

# Recordings of a few seconds each: five structures, orders 0 to 6, a delay of 52 samples, feedback,
# outliers, missing samples, offsets and units.
CASES = (15, 16, 24, 25, 26, 62, 245)


@pytest.fixture(scope="module")
def lines():
    return {number: calibration.run(number) for number in CASES}


def test_every_recording_gives_a_model(lines):
    assert [line.get("fault") or line.get("refused") for line in lines.values()] == [None] * len(
        CASES
    )


def test_every_delay_is_found(lines):
    for line in lines.values():
        assert all(abs(delay - line["delay"]) <= 2 for delay in line["delays"])


def test_the_bound_of_a_delay_leaves_the_taps_of_a_response_open():
    """White input and noise: only what a later response has before and after all taps tells it."""
    case = draw_case(319)
    taps, (u, y) = case.system.taps[0, 0], case.clean
    noise = (y - case.system.respond(np.vstack([case.earlier, u]))[-len(y) :]).std()
    told = 0.5 * u.std() * np.sqrt(len(u)) * np.hypot(taps[0], taps[-1])
    assert case.delay_error() == pytest.approx(noise / told, rel=0.05)


def test_trusted_modes_are_those_of_the_systems(lines):
    found = [line["modes"] for line in lines.values()]
    assert sum(modes["visible"] for modes in found) == 4
    assert sum(modes["missed"] for modes in found) == sum(modes["false"] for modes in found) == 0


def test_intervals_of_frequency_and_damping_cover_the_truth(lines):
    counts = [line["modes"][name] for line in lines.values() for name in ("frequency", "damping")]
    covered, of_all = map(sum, zip(*counts, strict=True))
    assert of_all >= 8
    assert covered >= of_all - 1


def test_bands_of_gain_and_phase_cover_the_truth(lines):
    """Also where the structure was chosen from the same samples."""
    for name in ("gain", "phase"):
        assert min(line[name] for line in lines.values()) > 0.8
        assert sum(line[name] for line in lines.values()) > 0.95 * len(lines)


def test_responses_come_near_to_those_of_the_true_orders(lines):
    ratios = [
        line["response_error"] / line["oracle"] for line in lines.values() if "oracle" in line
    ]
    assert len(ratios) == 6
    assert max(ratios) < 1.5
    excited = [line["excited"] for line in lines.values() if "excited" in line]
    assert max(error / of_oracle for error, of_oracle in excited) < 1.5


def test_the_excited_band_is_where_the_input_has_power():
    """A sweep that began long before the recording, and white noise."""
    swept, white = draw_case(3380), draw_case(3370)
    (low, high), (first, last) = calibration.excited_band(swept), swept.band
    assert first < 0.5 * low < low < high <= last
    assert calibration.excited_band(white) == pytest.approx(white.band, rel=0.05)


def test_good_responses_are_near_the_truth(lines):
    good = [line for line in lines.values() if line["verdict"]["response"] == "good"]
    assert len(good) >= 4
    assert max(line["response_error"] for line in good) < 0.1


def test_standard_errors_are_good_of_no_chosen_model(lines):
    """They leave out the choice."""
    assert all(line["verdict"]["errors"] != "good" for line in lines.values())
