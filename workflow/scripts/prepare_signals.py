"""Make both signals stationary and cut them into estimation and validation samples."""

from typing import TYPE_CHECKING, Any

from evopem.config.order_grid import check_samples
from evopem.files.job import job
from evopem.signals.preparation import prepare, save_prepared
from evopem.signals.recording import load_recording

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(
    recording_file: str,
    validation_file: str | None,
    settings: dict[str, Any],
    dataset: str,
    prepared_file: str,
    transforms_file: str,
) -> None:
    prepared = prepare(
        load_recording(recording_file),
        settings["stationarity"],
        settings["split"],
        None if settings["resample"] == "none" else float(settings["resample"]),
        load_recording(validation_file) if validation_file else None,
        dataset,
    )
    counts = (prepared.estimation.samples, prepared.validation.samples)
    check_samples(settings["needs"], *counts, f"datasets.{dataset}")
    save_prepared(prepared, prepared_file, transforms_file)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            snakemake.input.recording,
            snakemake.input.get("validation_recording"),
            {key: snakemake.params[key] for key in ("stationarity", "split", "resample", "needs")},
            snakemake.wildcards.dataset,
            snakemake.output.prepared,
            snakemake.output.transforms,
        )
