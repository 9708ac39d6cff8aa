"""Identify what the guides show, and write it into docs/gallery/.

`make docs` runs it, so that what the site shows is of the code as it is.
"""

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import yaml
from draw_softening import softening_picture
from scipy.signal import lfilter

import evopem
from evopem.figures import svg_texts
from evopem.pipeline.report import merge_fleets

ROOT = Path(__file__).resolve().parent.parent
GALLERY = ROOT / "docs" / "gallery"
BENCH = ROOT / "examples" / "motor_bench"
RATE = 200.0  # Hz
MODES = ((11.0, 0.012), (24.0, 0.015), (43.0, 0.02))  # natural frequency in Hz, damping ratio
SHAPES = np.array([[0.4, 0.9, 1.0], [0.8, 0.5, -0.9], [1.0, -0.8, 0.5]])
SENSORS = [f"acc_{k}" for k in (1, 2, 3)]
BEAM = {
    "points": {"root": [0, 0, 0]} | {name: [k, 0, 0] for k, name in enumerate(SENSORS, start=1)},
    "lines": [["root", "acc_1"], ["acc_1", "acc_2"], ["acc_2", "acc_3"]],
    "channels": {name: {"point": name, "direction": "y"} for name in SENSORS},
}
# Figures that stand in other guides, by the report that they are of.
PICTURES = {
    "motor_bench": ("gain", "frequency_response", "stabilization"),
    "beam": ("frequency_response",),
}


def motor_bench() -> dict[str, evopem.Results]:
    """A good recording, and the same one with its velocity cut off."""
    keys = yaml.safe_load((BENCH / "config.yaml").read_text(encoding="utf-8"))
    known = keys["datasets"]["motor_bench"]
    for key in ("file", "validation_file"):
        known.pop(key)
    first, second = (pd.read_csv(BENCH / f"multisine_{name}.csv") for name in "ab")
    good = evopem.identify(first, validation=second, name="motor_bench", **known)
    clipped = first.assign(omega_may=first["omega_may"].clip(-4.0, 4.0))
    return {"motor_bench": good, "clipped": evopem.identify(clipped, name="clipped", **known)}


def beam(samples: int, softer: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A force, and accelerations of three sensors along a beam, (N,) and (N, 3)."""
    force, *noise = np.random.default_rng(seed).standard_normal((4, samples + 500))
    outputs = np.zeros((samples + 500, 3))
    for (frequency, damping), shape in zip(MODES, SHAPES, strict=True):
        pole = np.exp(2.0 * np.pi * frequency * (1.0 - softer) / RATE * (1j - damping))
        part = lfilter([0.0, 1.0, -1.0], np.poly([pole, pole.conj()]).real, force)
        outputs += np.outer(part / part.std(), shape)
    outputs += 0.05 * np.column_stack(noise)
    return force[500:], outputs[500:]


def several() -> dict[str, evopem.Results]:
    """A beam that is shaken by a known force, and by an unknown one."""
    force, outputs = beam(2000, 0.0, 1)
    frame = pd.DataFrame(outputs, columns=SENSORS).assign(force=force)
    known = {"output": SENSORS, "sampling_rate": RATE, "orders": {"nx": [4, 8]}, "geometry": BEAM}
    known["search"] = {"evaluations": 1000}
    return {
        "beam": evopem.identify(frame, input="force", name="beam", structure="ss_oe", **known),
        "beam_outputs": evopem.identify(frame, name="beam_outputs", structure="ss", **known),
    }


def fleet() -> None:
    """Eight days of the beam, which is softer from the sixth on, on one page."""
    known = {"transforms": {"box_cox": "none", "difference": 0}, "split": {"discard": 0}}
    known |= {"recipe": "chapter", "structure": "oe", "orders": (6, 6, 1)}
    with TemporaryDirectory() as folder:
        for day in range(1, 9):
            force, outputs = beam(1000, 0.02 * (day > 5), day)
            found = evopem.identify(force, outputs[:, 0], RATE, name=f"day_{day}", **known)
            found.save(f"{folder}/days/{found.name}")
            (GALLERY / "days" / found.name).mkdir(parents=True)
            found.report(GALLERY / "days" / found.name / "report.html")
        merge_fleets([f"{folder}/days"], f"{folder}/fleet")
        shutil.copytree(f"{folder}/fleet", GALLERY / "fleet")


def main() -> None:
    """Replace the gallery."""
    shutil.rmtree(GALLERY, ignore_errors=True)
    GALLERY.mkdir()
    reports = motor_bench() | several()
    for name, found in reports.items():
        found.report(GALLERY / f"{name}.html")
        drawn = svg_texts(found.results) if name in PICTURES else {}
        for figure in PICTURES.get(name, ()):
            (GALLERY / f"{name}-{figure}.svg").write_text(drawn[figure], encoding="utf-8")
    good, bad = reports["motor_bench"], reports["clipped"]
    good.compare(bad).report(GALLERY / "compared.html")
    fleet()
    (GALLERY / "softening.svg").write_text(softening_picture(), encoding="utf-8")
    # Written last: make takes it for the whole.
    files = sorted(path.relative_to(GALLERY).as_posix() for path in GALLERY.rglob("*.html"))
    (GALLERY / "index.txt").write_text("\n".join([*files, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
