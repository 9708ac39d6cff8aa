"""Take one recording through all stages in one process, by the stages' own scripts."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import complete_model
import draw_figures
import estimate_spectrum
import fit_candidates
import prepare_signals
import read_recording
import select_candidate
import summarize_data_set
import synthesize_recording
import tabulate_candidates
import validate_model
import write_configuration
import write_report
from evopem.config.order_grid import PHASES, needs_peaks
from evopem.files.job import job

if TYPE_CHECKING:
    from logging import Logger

    from snakemake.iocontainers import snakemake


def main(
    name: str,
    folder: Path,
    settings: dict[str, Any],
    outputs: set[str],
    workflow: Path,
    logger: "Logger",
    cores: int,
) -> None:
    dataset = settings["dataset"]

    def at(*names: str) -> list[str]:
        return [str(folder / each) for each in names]

    def named(**names: str) -> dict[str, str]:
        return {key: str(folder / each) for key, each in names.items()}

    def there(*names: str) -> list[str]:
        return at(*(each for each in names if each in outputs))

    (config_file,) = at("config.yaml")
    write_configuration.main(name, dataset, config_file)

    recording = at("recording.npz", "recording.json")
    validation_recording = there("validation_recording.npz", "validation_recording.json")
    if "file" in dataset:
        read_recording.main(dataset["file"], settings["channels"], *recording)
        if validation_recording:
            file = dataset["validation_file"]
            read_recording.main(file, settings["channels"], *validation_recording)
    else:
        synthesis = settings["synthesis"]
        synthesize_recording.main(dataset["synthesis"], synthesis, *recording, *at("truth.json"))

    prepared = at("prepared.npz", "transforms.json")
    prepare_signals.main(
        recording[0],
        next(iter(validation_recording), None),
        dataset | {"needs": settings["needs"]},
        name,
        *prepared,
    )
    spectrum = at("spectrum.csv", "spectrum.json")
    estimate_spectrum.main(tuple(prepared), dataset["spectrum"], *spectrum)

    phases = at(*(f"phases/{phase}.json" for phase in PHASES))
    search, start = dataset["search"], settings["scoring_start"]
    previous = None
    for phase, phase_file in zip(PHASES, phases, strict=True):
        grid = settings["grids"][phase]
        peaks = spectrum[1] if needs_peaks(grid) else None
        params = {"grid": grid, "parts": 1, "search": search, "scoring_start": start}
        (part,) = at(f"phases/{phase}/part-1.json")
        fit_candidates.main(tuple(prepared), previous, peaks, phase, 1, params, part, logger, cores)
        again = {"search": search, "scoring_start": start}
        select_candidate.main([part], tuple(prepared), phase, again, phase_file, logger)
        Path(part).unlink()  # the phase holds all of it
        previous = phase_file

    model = named(
        model="model.json",
        matlab="model.mat",
        modes="modes.csv",
        frequency_response="frequency_response.csv",
    )
    complete_model.main(phases[-1], tuple(prepared), search, start, model)
    candidates = at("candidates.csv")
    tabulate_candidates.main(phases, *candidates)
    validation = named(
        validation="validation.json",
        residual_autocorrelation="residual_autocorrelation.csv",
        cross_correlation="cross_correlation.csv",
        simulation="simulation.csv",
    )
    validate_model.main(model["model"], tuple(prepared), validation)
    summary = at("recording.json", "transforms.json", "spectrum.json")
    summary += [*candidates, model["model"], validation["validation"]]
    summarize_data_set.main(summary, *at("summary.json"))

    figures = there(*(each for each in sorted(outputs) if each.startswith("figures/")))
    if figures:
        tables = [*candidates, model["model"], model["frequency_response"], *validation.values()]
        results = [*recording, *prepared, *spectrum, *phases, *tables, *there("truth.json")]
        draw_figures.main(results, figures)
        results += [*figures, config_file, *validation_recording[1:]]
        write_report.main(results, workflow, name, *at("report.html"))


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output) as log:
        own = Path(snakemake.log[0]).parents[1]
        main(
            snakemake.wildcards.dataset,
            own,
            snakemake.params.settings,
            {Path(file).relative_to(own).as_posix() for file in snakemake.output},
            Path(snakemake.scriptdir).parent,
            log,
            snakemake.threads,
        )
