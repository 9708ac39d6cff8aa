"""Follow the mode of a beam whose support moves; writes a section of docs/evidence/varying.md.

    python benchmarks/moving_roller.py DATA

Measured by Vereen, Downey, Dodson & Moura (2023): a cantilever on a roller that moves along it.
DATA is the folder of that name in
github.com/High-Rate-SHM-Working-Group/Dataset-8-DROPBEAR-Acceleration-vs-Roller-Displacement.
A model along the position of the roller, which moves at random, is judged on recordings in which it
goes step by step.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from evidence import write_section
from scipy.signal import resample_poly
from scipy.signal.windows import hann

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "workflow" / "scripts"))

from evopem import Recording, estimate_varying
from evopem.estimation.varying import Scheduled
from evopem.estimation.varying_choice import race
from evopem.models.varying import VaryingModel

ABOUT = """Measured, not in this repository (Vereen, Downey, Dodson & Moura 2023, set 8 of the
High-Rate-SHM-Working-Group, on GitHub): the acceleration of a cantilever on a roller, that nothing
else excites, decimated to 200 Hz, and the position of the roller as the condition. Estimated on a
recording of 12 s in which the roller moves at random, judged on two others in which it goes step
by step, where both have the same positions: spectral peaks where it rests for 0.4 s.
"""
# Of the recordings, and after their decimation (Hz): the first mode alone is below its half.
MEASURED, RATE = 5000, 200
ORDER, CONSTANT_ORDER, RECORDINGS = 6, 10, 2
# Samples of a window at rest, how far the roller may move in it (V), and the least deviation of the
# acceleration (V).
WINDOW, REST, LEAST = 80, 0.05, 0.02
BAND = 20.0, 60.0


def measured(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration and position of the roller (both V), (N,), decimated."""
    names = file.read_text(encoding="utf-8").splitlines()[5].split("\t")
    table = np.loadtxt(file, skiprows=8)
    signals = [table[:, names.index(name)] for name in ("Low G Accel", "PinLoc")]
    down = [resample_poly(s - s[0], 1, MEASURED // RATE) + s[0] for s in signals]
    return down[0], down[1]


def peaks(y: np.ndarray, position: np.ndarray) -> list[tuple[float, float]]:
    """Position and frequency of the highest peak of windows in which the roller rests."""
    found, start, points = [], 0, 16 * WINDOW
    frequencies = np.fft.rfftfreq(points, 1.0 / RATE)
    within = (frequencies > BAND[0]) & (frequencies < BAND[1])
    while start + WINDOW <= len(y):
        part, at = y[start : start + WINDOW], position[start : start + WINDOW]
        rests = bool(np.ptp(at) < REST and np.std(part) > LEAST)
        if rests:
            size = np.abs(np.fft.rfft((part - part.mean()) * hann(WINDOW), points))
            found.append((float(at.mean()), float(frequencies[within][size[within].argmax()])))
        start += WINDOW if rests else WINDOW // 5
    return found


def one_step(model: VaryingModel, y: np.ndarray, position: np.ndarray) -> float:
    """Error of prediction in percent of the output's deviation, where the model is known."""
    within = (position >= model.basis.low) & (position <= model.basis.high)
    clipped = np.clip(position, model.basis.low, model.basis.high)
    errors = y - model.predict(np.zeros((len(y), 0)), y, clipped)
    return 100.0 * float(np.sqrt(np.nanmean(errors[within] ** 2)) / np.std(y[within]))


def main(data: Path) -> None:
    at_random = data / "Random Index Set Random Dwell" / "set0" / "trial data" / "test0.txt"
    steps = data / "Slow Postional Displacement" / "trial data" / "10steps"
    y, position = measured(at_random)
    given = {"schedule": position, "condition": "roller", "orders": ORDER}
    found = estimate_varying(None, y, RATE, **given)
    scheduled = Scheduled.of(Recording(np.zeros((len(y), 0)), y, RATE), position)
    constant = race(scheduled, CONSTANT_ORDER, (), ("legendre",), (1,))[0].model
    print(repr(found), found.model.text, constant.text, flush=True)
    moving, compared, errors = found.model, [], []
    for number in range(RECORDINGS):
        y, position = measured(steps / f"test{number}.txt")
        errors += [one_step(model, y, position) for model in (moving, constant)]
        for at, peak in peaks(y, position):
            if moving.basis.low <= at <= moving.basis.high:
                modes = moving.frozen(at).modes()
                mode = min(modes, key=lambda mode: abs(mode.frequency_hz - peak))
                compared.append((at, peak, mode.frequency_hz, 1.96 * mode.frequency_se_hz))
    places = np.round(np.array(compared)[:, 0], 1)
    rows = []
    for place in np.unique(places):
        at, peak, hz, width = np.array(compared)[places == place].T
        spread = f"{peak.min():.1f} to {peak.max():.1f}"
        rows.append((f"{at.mean():.2f}", len(at), spread, f"{hz.mean():.1f} ± {width.mean():.1f}"))
    apart = np.sqrt(np.mean([(peak - hz) ** 2 for _, peak, hz, _ in compared]))
    moved = " and ".join(f"{error:.1f}" for error in errors[::2])
    stayed = " and ".join(f"{error:.1f}" for error in errors[1::2])
    write_section(
        "varying",
        "A beam whose support moves",
        f"{ABOUT}One step ahead, {moved} % are left by {moving.text}, {stayed} % by the best"
        f" constant {constant.text.partition(' ')[0]}; frequencies differ from peaks by"
        f" {apart:.2f} Hz (root of the mean square).\n",
        "python benchmarks/moving_roller.py DATA",
        ("roller (V)", "windows", "peak (Hz)", "moving model (Hz)"),
        rows,
        f"For Python, `estimate_varying` says: {found!r}",
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
