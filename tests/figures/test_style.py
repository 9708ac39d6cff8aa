"""The parts every figure shares."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from evopem.figures import style
from evopem.figures.chart import FAMILY, FAMILY_MARKERS
from evopem.results.channel_labels import Channel, gain_unit, with_unit


@given(
    arrays(
        float,
        st.integers(1, 400),
        elements=st.floats(-1e6, 1e6) | st.just(float("nan")),
    ),
    st.integers(1, 20),
)
def test_decimation_keeps_the_envelope(y, bins):
    x = style.extremes(y, bins)
    kept = y[x]
    assert kept.size <= max(4 * bins, 1)
    assert np.all(np.diff(x) > 0)
    edges = np.linspace(0, y.size, bins + 1).astype(int)
    if y.size > 4 * bins:
        for start, stop in pairwise(edges):
            values = y[start:stop][np.isfinite(y[start:stop])]
            shown = kept[(x >= start) & (x < stop)]
            assert shown.size == min(2, np.unique(values).size) or values.size == 0
            if values.size:
                assert (shown.min(), shown.max()) == (values.min(), values.max())


def test_a_short_series_is_drawn_as_it_is():
    y = np.array([1.0, np.nan, 3.0])
    np.testing.assert_array_equal(style.extremes(y, 10), np.arange(3))


def test_stems_start_at_zero():
    x, y = style.stems([1, 2], [0.5, -0.3])
    np.testing.assert_array_equal(x, [1, 1, np.nan, 2, 2, np.nan])
    np.testing.assert_array_equal(y, [0, 0.5, np.nan, 0, -0.3, np.nan])


@pytest.mark.parametrize(
    ("value", "label"),
    [(1, "1"), (0.01, "0.01"), (1000, "1000"), (1e-5, "10⁻⁵"), (2e-7, "2·10⁻⁷"), (1e12, "10¹²")],
)
def test_labels_of_logarithmic_axes(value, label):
    assert style.power_of_ten(value) == label


@pytest.mark.parametrize(
    ("output", "given", "unit"),
    [
        ("V", "A", "V/A"),
        ("m/s²", "N m", "m/s²/(N m)"),
        ("m/s²", "rad/s", "m/s²/(rad/s)"),
        ("", "A", ""),
        ("V", "", ""),
    ],
)
def test_unit_of_a_gain(output, given, unit):
    assert gain_unit(Channel("", "", "", output), Channel("", "", "", given)) == unit


def test_labels_are_printable():
    assert with_unit("torque\x00\n", "N m") == "torque\ufffd\ufffd (N m)"
    assert with_unit("torque", "") == "torque"


def luminance(colour):
    r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def test_every_role_has_a_colour_of_its_own():
    roles = [
        style.INK,
        style.MUTED,
        style.GRID,
        style.PAPER,
        *(style.COLOURS[role] for role in FAMILY[:5]),
    ]
    assert len(set(roles)) == len(roles)
    # Curves drawn together also differ in marker.
    assert len(set(FAMILY_MARKERS)) == len(FAMILY)
    # Text and model stand out from the paper in greyscale too.
    assert luminance(style.PAPER) - luminance(style.ERROR) > 100
    assert luminance(style.PAPER) - luminance(style.MODEL) > 100
