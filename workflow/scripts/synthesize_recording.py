"""Simulate a system whose truth is known."""

from typing import TYPE_CHECKING, Any

from evopem.console import job
from evopem.signals.recording import save_recording
from evopem.synthesis import synthesize
from evopem.writing import write_json

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(
    kind: str, settings: dict[str, Any], recording_file: str, origin_file: str, truth_file: str
) -> None:
    recording, truth = synthesize(kind, **settings)
    save_recording(recording, recording_file)
    origin = {
        "kind": "synthesis",
        "samples": recording.samples,
        "sampling_rate": recording.sampling_rate,
        "input_name": recording.input_name,
        "output_name": recording.output_name,
        "input_unit": recording.input_unit,
        "output_unit": recording.output_unit,
    }
    write_json(origin_file, origin)
    write_json(truth_file, truth)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            snakemake.params.kind,
            snakemake.params.settings,
            snakemake.output.recording,
            snakemake.output.origin,
            snakemake.output.truth,
        )
