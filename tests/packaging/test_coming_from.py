"""The calls of MATLAB in docs/coming_from.md that Octave's control package has, beside ours."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import evopem

PAGE = Path(__file__).parents[2] / "docs" / "coming_from.md"
# Of MATLAB's functions on the page Octave has iddata, detrend and n4sid under the same calls.
THEIRS = """
pkg load control
u = load('u.txt'); y = load('y.txt');
%s
%s
m = n4sid(data, 2);
printf('%%.17g\\n', real(pole(m)), imag(pole(m)), size(ze, 1), size(zv, 1), mean(ze.y{1}));
"""


def line_of(page, beginning):
    return re.search(rf"^{re.escape(beginning)}.*$", page, re.MULTILINE)[0]


def test_octave_estimates_the_same(tmp_path):
    octave = shutil.which("octave-cli")
    has_control = octave and "Cannot" not in printed(octave, "pkg load control", tmp_path)
    if not has_control:
        pytest.skip("Octave's control package is not installed (Debian: octave-control)")
    u, e = np.random.default_rng(1).standard_normal((2, 600))
    y = lfilter([0.0, 0.3, 0.2], [1.0, -1.3, 0.55], u) + lfilter([1.0], [1.0, -1.3, 0.55], 0.1 * e)
    for name, signal in (("u", u), ("y", y)):
        np.savetxt(tmp_path / f"{name}.txt", signal, fmt="%.17g")
    page = PAGE.read_text(encoding="utf-8")
    code = THEIRS % (line_of(page, "data ="), line_of(page, "ze ="))
    *found, first, last, mean = map(float, printed(octave, code, tmp_path).split())
    assert (first, last) == (480, 120)
    assert abs(mean) < 1e-12
    theirs = np.array(found[:2]) + 1j * np.array(found[2:])
    (mode,) = evopem.estimate(u, y, 2, 100.0, structure="ss", level=True).model.modes()
    s = 100.0 * np.log(theirs[theirs.imag > 0][0])
    # Two estimates from the same samples differ by less than the sum of their standard errors.
    assert abs(s) / (2.0 * np.pi) == pytest.approx(
        mode.frequency_hz, abs=2.0 * mode.frequency_se_hz
    )
    assert -s.real / abs(s) == pytest.approx(mode.damping_ratio, abs=2.0 * mode.damping_se)


def printed(octave, code, folder):
    command = [octave, "--no-gui", "--quiet", "--eval", code]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    return run.stdout if run.returncode == 0 else f"Cannot: {run.stderr}"
