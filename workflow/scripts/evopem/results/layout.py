"""Where every file of the results lies: rules, stages, report and tests take every path from here.

Nothing here imports numpy or pandas: a Snakefile uses this module.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from evopem.config.conditions import Following
from evopem.config.source_checks import RESULTS_FOLDER as FOLDER
from evopem.errors import InputError

_RESPONSES = ("frequency_response.csv", "spectrum.csv")
_CORRELATIONS = ("residual_autocorrelation.csv", "cross_correlation.csv")


class Figure(NamedTuple):
    """One figure of the report; ``captions.html.j2`` has its title and caption."""

    part: str  # of the page
    module: str  # of :mod:`evopem.figures`, with a function of the figure's name
    data: tuple[str, ...]  # names of the files of the results that hold what is drawn
    in_time: bool = True  # whether it needs a recording, which frequency responses are not


FIGURES = {
    "measured_and_simulated": Figure("summary", "time_domain", ("simulation.csv",)),
    "gain": Figure("summary", "frequency_domain", _RESPONSES, False),
    "poles_zeros": Figure("modes", "orders", ("model.json",), False),
    "stabilization": Figure("modes", "orders", ("validation.json",), False),
    "frequency_response": Figure("response", "frequency_domain", _RESPONSES, False),
    "step_and_impulse": Figure("response", "time_domain", ("time_response.csv",), False),
    "nyquist": Figure("response", "frequency_domain", _RESPONSES, False),
    "simulation": Figure("errors", "time_domain", ("simulation.csv",)),
    "simulation_as_recorded": Figure("errors", "time_domain", ("simulation.csv",)),
    "horizons": Figure("errors", "time_domain", ("horizons.csv",)),
    "residual_correlation": Figure("residual_tests", "time_domain", _CORRELATIONS),
    "residual_spectrum": Figure("residual_tests", "frequency_domain", ("simulation.csv",)),
    "record": Figure("recording", "time_domain", ("recording.npz", "prepared.npz")),
    "spectrum": Figure("recording", "frequency_domain", ("spectrum.csv",)),
    "delay": Figure("selection", "orders", ("candidates.csv",)),
    "phases": Figure("selection", "orders", ("candidates.csv",)),
    "convergence": Figure("selection", "orders", ("model.json",)),
}
"""The figures of the report, in its order."""

OVERVIEW = tuple(
    f"{FOLDER}/{name}" for name in ("index.html", "fleet.csv", "fleet.parquet", "fleet_modes.csv")
)
"""The lists of all data sets."""

DAMAGE = f"{FOLDER}/damage_index.csv"  # the list of damage indices, where a reference is named


def lists_of(following: Following) -> tuple[str, ...]:
    """The lists of all data sets that a run makes."""
    return OVERVIEW if following.reference is None else (*OVERVIEW, DAMAGE)


SETUPS = f"{FOLDER}/setups/{{structure}}.html"  # the page of a structure with several set-ups

IDENTIFICATION = "identification"  # the job that takes a recording through all stages

BATCH = "batches/{batch}"  # the job that does so for several recordings

BATCH_CHECKSUMS = f"{FOLDER}/checksums/{BATCH}.sha256"
"""What the job of a batch writes when all its recordings are identified."""


class _File:
    """The path of a file in a data set's folder."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get__(self, files: DatasetFiles, owner: type | None = None) -> str:
        return f"{files.folder}/{self.name}"


@dataclass(frozen=True)
class DatasetFiles:
    """The files of one data set."""

    folder: str  # the data set's folder; in a rule it holds the wildcard, ``results/{dataset}``

    @classmethod
    def of_dataset(cls, name: str) -> DatasetFiles:
        """The files of a data set below the working directory."""
        return cls(f"{FOLDER}/{name}")

    @classmethod
    def of_log(cls, log_file: str | Path) -> DatasetFiles:
        """The files of the data set that a log file belongs to."""
        return cls(str(next(up.parent for up in Path(log_file).parents if up.name == "logs")))

    @property
    def name(self) -> str:
        """Name of the data set."""
        return Path(self.folder).name

    config = _File("config.yaml")  # the complete configuration of the data set
    recording = _File("recording.npz")  # samples of the recording
    recording_info = _File("recording.json")  # origin and properties of the recording
    validation_recording = _File("validation_recording.npz")  # the independent one
    validation_recording_info = _File("validation_recording.json")  # its origin and properties
    truth = _File("truth.json")  # the system behind a synthetic recording
    prepared = _File("prepared.npz")  # estimation and validation samples after all transforms
    transforms = _File("transforms.json")  # the transforms, with what undoes them
    spectrum = _File("spectrum.csv")  # multitaper, and the empirical frequency response
    spectrum_summary = _File("spectrum.json")  # settings and peaks of the spectrum

    def part(self, phase: str, part: int | str) -> str:
        """Candidates of one job of a phase."""
        return f"{self.phase_folder}/{phase}/part-{part}.json"

    phase_folder = _File("phases")  # folder with the files of all phases

    def phase(self, phase: str) -> str:
        """Selection and all candidates of a phase."""
        return f"{self.phase_folder}/{phase}.json"

    def decision(self, subject: str) -> str:
        """One decision of the automatic recipe."""
        return f"{self.folder}/decisions/{subject}.json"

    def search(self, structure: str) -> str:
        """The search of one structure's orders by the automatic recipe."""
        return self.decision(f"search/{structure}")

    def models_of_orders(self, form: str) -> str:
        """The models of all orders of one form with its weighting, of several channels."""
        return self.decision(f"orders/{form}")

    decisions = _File("decisions.json")  # all of the automatic recipe, and trials of revisions
    candidates = _File("candidates.csv")  # every candidate of every phase
    model = _File("model.json")  # the model, for evopem and people

    def other_model(self, purpose: str) -> str:
        """The model of an automatic recipe for another purpose than that of :attr:`model`."""
        return f"{self.folder}/model.{purpose}.json"

    model_mat = _File("model.mat")  # the model, for MATLAB
    modes = _File("modes.csv")  # natural frequencies and damping ratios of plant and noise filter
    frequency_response = _File("frequency_response.csv")  # of plant and noise, with 95 % bands
    time_response = _File("time_response.csv")  # impulse and step responses with 95 % intervals
    horizons = _File("horizons.csv")  # errors of k-step predictions of the validation samples, by k
    validation = _File("validation.json")  # errors and residual tests
    residual_autocorrelation = _File("residual_autocorrelation.csv")  # by lag
    cross_correlation = _File("cross_correlation.csv")  # of residuals and inputs, by lag
    simulation = _File("simulation.csv")  # validation samples, predicted and simulated
    varying = _File("varying.json")  # the model whose coefficients move, or why there is none
    varying_modes = _File("varying_modes.csv")  # its frozen modes over time with 95 % intervals
    summary = _File("summary.json")  # orders, errors, modes and checks
    verdict = _File("verdict.json")  # what the model is good for, for programs
    report = _File("report.html")  # the report

    def figure(self, figure: str) -> str:
        """One figure of the report."""
        return f"{self.folder}/figures/{figure}.svg"

    @property
    def figures(self) -> list[str]:
        """All figures of the report, in its order."""
        return [self.figure(figure) for figure in FIGURES]

    details = _File("details.zip")  # all other results of a recording of a batch

    def read_again(self) -> list[str]:
        """What an attribute names, but for the report, which a notebook may write there too."""
        names = [name for name, value in vars(DatasetFiles).items() if isinstance(value, _File)]
        return [getattr(self, name) for name in names if name != "report"]

    @property
    def checksums(self) -> str:
        """Checksums of the results that one job has made."""
        return f"{self.folder}/checksums/{IDENTIFICATION}.sha256"

    logs = _File("logs")  # folder of the logs

    @property
    def batch_results(self) -> list[str]:
        """The results of a recording that was identified in a batch."""
        named = [self.recording_info, self.model, self.modes, self.validation]
        return [*named, self.summary, self.verdict, self.details]

    def log(self, job: str) -> str:
        """Log of a job."""
        return f"{self.folder}/logs/{job}.log"

    def benchmark(self, job: str) -> str:
        """Time and memory of a job."""
        return f"{self.folder}/benchmarks/{job}.tsv"


def check_folders(folders: Iterable[str | Path]) -> None:
    """Refuse files, links to nothing, and names that are none, where folders must be."""
    for folder in map(Path, folders):
        try:
            is_other = (folder.is_symlink() or folder.exists()) and not folder.is_dir()
        except OSError as error:
            problem = f"cannot be the name of a folder ({error.strerror})"
            raise InputError(str(folder), problem, "give a shorter one") from None
        if is_other:
            problem = "is no folder, and the results need a folder of this name"
            raise InputError(str(folder), problem, "move it, or choose another")
