"""Run the calls of pyOMA2 and SIPPY in docs/coming_from.md, and ours beside them, on the same data.

tests/packaging/peers.sh runs it in an environment with these programs. Two estimates of one system
from the same samples differ by less than the sum of their standard errors, of which ours stand for
both: a mode that is another, a delay counted otherwise or a wrong unit differs by much more.
"""

import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
from pyoma2.algorithms import SSI
from pyoma2.setup import SingleSetup
from scipy.signal import lfilter
from sippy_unipi import system_identification

import evopem

PAGE = Path(__file__).parents[2] / "docs" / "coming_from.md"
STANDARD_ERRORS = 2.0


def calls(program):
    """Theirs and ours of one part of the page."""
    part = re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    (text,) = [each for each in part if each.startswith(f"{program}\n")]
    return [re.search(rf"```{kind}\n(.*?)```", text, re.DOTALL)[1] for kind in ("text", "python")]


def models(code, **known):
    """What ``m`` was after each line of some code, and all names at its end."""
    names, found = {"evopem": evopem} | known, []
    for line in code.splitlines():
        exec(line, names)
        if "m" in names and (not found or names["m"] is not found[-1]):
            found.append(names["m"])
    return found, names


def compare(what, theirs, ours, error):
    apart = abs(theirs - ours) / error
    print(f"{what}: {theirs:.4f}, ours {ours:.4f}, {apart:.2f} standard errors apart")
    assert apart <= STANDARD_ERRORS


def compare_modes(name, poles, model):
    (mode,) = model.modes()
    (s,) = 100.0 * np.log(poles[poles.imag > 0])
    compare(f"{name}, Hz", abs(s) / (2 * np.pi), mode.frequency_hz, mode.frequency_se_hz)
    compare(f"{name}, damping ratio", -s.real / abs(s), mode.damping_ratio, mode.damping_se)


def sippy():
    u, e = np.random.default_rng(1).standard_normal((2, 600))
    denominator = [1.0, -1.3, 0.55]
    y = lfilter([0.0, 0.3, 0.2], denominator, u) + lfilter([1.0, 0.5, 0.2], denominator, 0.1 * e)
    theirs, ours = calls("SIPPY")
    known = {"u": u, "y": y}
    (armax, n4sid), _ = models(theirs, system_identification=system_identification, **known)
    (polynomial, states), _ = models(ours, **known)
    compare_modes("SIPPY's ARMAX", np.asarray(armax.G.poles()), polynomial.model)
    compare_modes("SIPPY's N4SID", np.linalg.eigvals(n4sid.A), states.model)


def pyoma2():
    """A mode at 11 Hz that an unknown force drives, seen at two places."""
    pole = np.exp((-0.02 + 1j * np.sqrt(1.0 - 0.02**2)) * 2.0 * np.pi * 11.0 / 100.0)
    e = np.random.default_rng(1).standard_normal((3000, 3))
    motion = lfilter([1.0], np.poly([pole, pole.conj()]).real, e[:, 0])
    y = np.outer(motion, [1.0, 0.6]) + 0.5 * e[:, 1:]
    theirs, ours = calls("pyOMA2")
    _, names = models(theirs, SingleSetup=SingleSetup, SSI=SSI, y=y)
    _, own = models(ours.replace("100.0)", '100.0, structure="ss", show_progress=False)'), y=y)
    found = names["setup"]["ssi"].result
    mode = own["m"].modes.iloc[own["m"].modes["trusted"].to_numpy()].iloc[0]
    compare("pyOMA2's SSI, Hz", found.Fn[0], mode.frequency_hz, mode.frequency_se_hz)
    damping, error = mode.damping_percent / 100.0, mode.damping_se_percent / 100.0
    compare("pyOMA2's SSI, damping ratio", found.Xi[0], damping, error)


if __name__ == "__main__":
    mpl.use("agg")
    sippy()
    pyoma2()
