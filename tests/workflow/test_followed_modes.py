"""A run over recordings of one structure that softens half-way."""

import csv

import numpy as np
from scipy.signal import lfilter

from .conftest import TINY

RATE = 100.0


def recording(frequency, seed):
    """Noise through a resonance, measured with little noise."""
    generator = np.random.default_rng([5, seed])
    u, e = generator.standard_normal((2, 1200))
    pole = np.exp(2j * np.pi * frequency / RATE * (1.0 + 0.02j))
    plant = np.real(np.poly([pole, np.conj(pole)]))
    y = lfilter([0.0, 1.0, 0.5], plant, u)
    return np.column_stack([u, y + 0.02 * y.std() * e])[200:]


def test_a_drop_of_the_stiffness_is_reported_with_its_recording(folder):
    rows = ["name,file,sampling_rate,conditions.day"]
    for number in range(1, 9):
        stiffness = 0.98 if number > 6 else 1.0
        samples = recording(12.0 * np.sqrt(stiffness), number)
        np.savetxt(folder.path / f"{number}.csv", samples, delimiter=",")
        # The names do not tell the order, the column does.
        rows.append(f"beam-{'hdbgacfe'[number - 1]},{number}.csv,100,{3 * number}")
    (folder.path / "recordings.csv").write_text("\n".join(rows) + "\n")
    analysis = TINY["defaults"] | {
        "structure": "oe",
        "delay": {"orders": [2, 2], "nk": [1, 1]},
        "orders": {"plant": [2, 2], "nb": [2, 2]},
        "transforms": {"box_cox": "none", "difference": 0},
    }
    config = {"datasets": "recordings.csv", "follow": "day", "reference": 6, "defaults": analysis}
    jobs = {"one_job_per": "recording", "recordings_per_job": 8}
    folder.configure(config | jobs | {"report": "none"})
    told = folder.finish("--cores", "2")
    with (folder.results / "fleet_modes.csv").open(encoding="utf-8") as stream:
        table = list(csv.DictReader(stream))
    assert [float(row["place"]) for row in table] == [3.0 * n for n in range(1, 9)]
    for row in table:
        # The undamped frequency of the pole.
        truth = np.hypot(12.0, 0.24) * (1.0 if float(row["place"]) <= 18.0 else np.sqrt(0.98))
        assert abs(float(row["frequency_hz"]) - truth) < 4.0 * float(row["frequency_se_hz"])
    assert [row["dataset"] for row in table if row["warning"]] == ["beam-f"]
    page = (folder.results / "index.html").read_text(encoding="utf-8")
    assert "from beam-f on" in page
    assert page.count('class="followed"') == 2
    with (folder.results / "damage_index.csv").open(encoding="utf-8") as stream:
        indices = {row["dataset"]: row for row in csv.DictReader(stream)}
    assert [name for name, row in indices.items() if row["reference"] == "False"][-1] == "beam-e"
    assert all(float(indices[name]["damage_index"]) > 1.0 for name in ("beam-f", "beam-e"))
    sentence = "2 of 2 recordings lie above the limit of the damage index"
    assert sentence in page
    assert sentence in told
    assert "beam-f (mode 1 by" in told
    assert folder.planned() == {}
