"""Give the chosen candidate its covariance, modes and frequency response."""

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evopem import __version__
from evopem.console import job
from evopem.estimation.order_search import recall
from evopem.models.armax import ArmaxModel
from evopem.models.files import save_model_json, save_model_mat
from evopem.models.gain_band import gain_band
from evopem.signals.preparation import load_prepared
from evopem.writing import write_table

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

FREQUENCIES = 2049
LIBRARIES = ("numpy", "scipy", "numba")


def main(
    phase_file: str,
    prepared_files: tuple[str, str],
    search: dict[str, Any],
    scoring_start: int,
    outputs: dict[str, str],
) -> None:
    phase = json.loads(Path(phase_file).read_text(encoding="utf-8"))
    chosen = next(
        candidate
        for candidate in phase["candidates"]
        if all(candidate[order] == value for order, value in phase["selected"].items())
    )
    estimate = recall(chosen, load_prepared(*prepared_files).estimation, search, scoring_start)
    found = {
        key: chosen[key]
        for key in ("evaluations", "generations", "populations", "agreement", "basins", "at_margin")
    }
    evidence = {
        "objective": {"name": estimate.objective, "value": estimate.objective_value},
        "fit_percent": estimate.fit_percent,
        "rss": estimate.rss,
        "bic": estimate.bic,
        "scoring_start": scoring_start,
        "transforms": json.loads(Path(prepared_files[1]).read_text(encoding="utf-8")),
        "search": {"settings": search, "found": found},
        "seed": search["seed"],
        "evopem": __version__,
        "versions": {"python": platform.python_version()}
        | {library: version(library) for library in LIBRARIES},
    }
    save_model_json(estimate.model, outputs["model"], evidence)
    save_model_mat(estimate.model, outputs["matlab"])
    write_table(outputs["modes"], modes_table(estimate.model))
    write_table(outputs["frequency_response"], response_table(estimate.model))


def modes_table(model: ArmaxModel) -> dict[str, Any]:
    return {
        "frequency_hz": [mode.frequency_hz for mode in model.modes()],
        "frequency_se_hz": [mode.frequency_se_hz for mode in model.modes()],
        "damping_percent": [100.0 * mode.damping_ratio for mode in model.modes()],
        "damping_se_percent": [100.0 * mode.damping_se for mode in model.modes()],
        "pole_real": [mode.pole.real for mode in model.modes()],
        "pole_imag": [mode.pole.imag for mode in model.modes()],
        "radius": [abs(mode.pole) for mode in model.modes()],
    }


def response_table(model: ArmaxModel) -> dict[str, Any]:
    frequencies = np.linspace(0.0, model.sampling_rate / 2.0, FREQUENCIES)
    response = model.frequency_response(frequencies)
    lower, upper = gain_band(model, frequencies)
    return {
        "frequency_hz": frequencies,
        "gain": np.abs(response),
        "gain_lower": lower,
        "gain_upper": upper,
        "phase_deg": np.degrees(np.unwrap(np.angle(response))),
    }


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.input.phase,
            (snakemake.input.prepared, snakemake.input.transforms),
            snakemake.params.search,
            snakemake.params.scoring_start,
            dict(snakemake.output.items()),
        )
