"""Where every file of the results lies, and the names of the phases and figures.

Rules, stage functions, report, fleet and tests take every path from here. Nothing here imports
numpy or pandas: a Snakefile uses this module.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from evopem.config.sample_sheet import RESULTS_FOLDER as FOLDER
from evopem.config.structures import PHASES, phases_of
from evopem.errors import InputError

FIGURES = (
    "measured_and_simulated",
    "gain",
    "poles_zeros",
    "stabilization",
    "frequency_response",
    "step_and_impulse",
    "nyquist",
    "simulation",
    "simulation_as_recorded",
    "horizons",
    "residuals",
    "residual_spectrum",
    "record",
    "spectrum",
    "delay",
    "phases",
    "convergence",
)
"""The figures of the report, in its order."""

INDEX = f"{FOLDER}/index.html"
FLEET_CSV = f"{FOLDER}/fleet.csv"
FLEET_PARQUET = f"{FOLDER}/fleet.parquet"
FLEET_MODES = f"{FOLDER}/fleet_modes.csv"
OVERVIEW = (INDEX, FLEET_CSV, FLEET_PARQUET, FLEET_MODES)
"""The lists of all data sets."""

IDENTIFICATION = "identification"
"""The job that takes a recording through all stages."""

BATCH = "batches/{batch}"
"""The job that does so for several recordings."""

BATCH_CHECKSUMS = f"{FOLDER}/checksums/{BATCH}.sha256"
"""What the job of a batch writes when all its recordings are identified."""


@dataclass(frozen=True)
class DatasetFiles:
    """The files of one data set.

    Attributes
    ----------
    folder : str
        The data set's folder; in a rule it holds the wildcard, ``results/{dataset}``.
    """

    folder: str

    @classmethod
    def of_dataset(cls, name: str) -> DatasetFiles:
        """The files of the data set of this name, below the working directory."""
        return cls(f"{FOLDER}/{name}")

    @classmethod
    def of_log(cls, log_file: str | Path) -> DatasetFiles:
        """The files of the data set that a log file belongs to."""
        return cls(str(next(up.parent for up in Path(log_file).parents if up.name == "logs")))

    @property
    def name(self) -> str:
        """Name of the data set."""
        return Path(self.folder).name

    @property
    def config(self) -> str:
        """The complete configuration of the data set."""
        return f"{self.folder}/config.yaml"

    @property
    def recording(self) -> str:
        """Samples of the recording."""
        return f"{self.folder}/recording.npz"

    @property
    def recording_info(self) -> str:
        """Origin and properties of the recording."""
        return f"{self.folder}/recording.json"

    @property
    def validation_recording(self) -> str:
        """Samples of the independent recording for validation."""
        return f"{self.folder}/validation_recording.npz"

    @property
    def validation_recording_info(self) -> str:
        """Origin and properties of the independent recording for validation."""
        return f"{self.folder}/validation_recording.json"

    @property
    def truth(self) -> str:
        """The system behind a synthetic recording."""
        return f"{self.folder}/truth.json"

    @property
    def prepared(self) -> str:
        """Estimation and validation samples after all transforms."""
        return f"{self.folder}/prepared.npz"

    @property
    def transforms(self) -> str:
        """The transforms, with what undoes them."""
        return f"{self.folder}/transforms.json"

    @property
    def spectrum(self) -> str:
        """Multitaper spectrum and empirical frequency response, by frequency."""
        return f"{self.folder}/spectrum.csv"

    @property
    def spectrum_summary(self) -> str:
        """Settings and peaks of the spectrum."""
        return f"{self.folder}/spectrum.json"

    def part(self, phase: str, part: int | str) -> str:
        """Candidates of one job of a phase."""
        return f"{self.phase_folder}/{phase}/part-{part}.json"

    @property
    def phase_folder(self) -> str:
        """Folder with the files of all phases."""
        return f"{self.folder}/phases"

    def phase(self, phase: str) -> str:
        """Selection and all candidates of a phase."""
        return f"{self.phase_folder}/{phase}.json"

    def phases(self, structure: str) -> list[str]:
        """Selections and candidates of all phases of a structure, in their order."""
        return [self.phase(phase) for phase in phases_of(structure)]

    def decision(self, subject: str) -> str:
        """One decision of the automatic recipe."""
        return f"{self.folder}/decisions/{subject}.json"

    def search(self, structure: str) -> str:
        """The search of one structure's orders by the automatic recipe."""
        return self.decision(f"search/{structure}")

    def models_of_orders(self, variant: str) -> str:
        """The models of all orders of one form with its weighting, of several channels."""
        return self.decision(f"orders/{variant}")

    @property
    def decisions(self) -> str:
        """All decisions of the automatic recipe, and its trials of remedies."""
        return f"{self.folder}/decisions.json"

    @property
    def candidates(self) -> str:
        """Every candidate of every phase."""
        return f"{self.folder}/candidates.csv"

    @property
    def model(self) -> str:
        """The model, for evopem and people."""
        return f"{self.folder}/model.json"

    def other_model(self, purpose: str) -> str:
        """The model of an automatic recipe for another purpose than that of :attr:`model`."""
        return f"{self.folder}/model.{purpose}.json"

    def other_errors(self, purpose: str) -> str:
        """What the model for another purpose reaches."""
        return self.decision(f"models/{purpose}")

    @property
    def model_mat(self) -> str:
        """The model, for MATLAB."""
        return f"{self.folder}/model.mat"

    @property
    def modes(self) -> str:
        """Natural frequencies and damping ratios of plant and noise filter."""
        return f"{self.folder}/modes.csv"

    @property
    def frequency_response(self) -> str:
        """Frequency responses of plant and noise filter with 95 % intervals."""
        return f"{self.folder}/frequency_response.csv"

    @property
    def time_response(self) -> str:
        """Impulse and step responses with 95 % intervals."""
        return f"{self.folder}/time_response.csv"

    @property
    def horizons(self) -> str:
        """Errors of k-step predictions of the validation samples, by k."""
        return f"{self.folder}/horizons.csv"

    @property
    def validation(self) -> str:
        """Errors and residual tests."""
        return f"{self.folder}/validation.json"

    @property
    def residual_autocorrelation(self) -> str:
        """Autocorrelation of the residuals, by lag."""
        return f"{self.folder}/residual_autocorrelation.csv"

    @property
    def cross_correlation(self) -> str:
        """Cross-correlation of residuals and input, by lag."""
        return f"{self.folder}/cross_correlation.csv"

    @property
    def simulation(self) -> str:
        """Validation samples, predicted and simulated."""
        return f"{self.folder}/simulation.csv"

    @property
    def summary(self) -> str:
        """Orders, errors, modes and checks."""
        return f"{self.folder}/summary.json"

    @property
    def report(self) -> str:
        """The report."""
        return f"{self.folder}/report.html"

    def figure(self, figure: str) -> str:
        """One figure of the report."""
        return f"{self.folder}/figures/{figure}.svg"

    @property
    def figures(self) -> list[str]:
        """All figures of the report, in its order."""
        return [self.figure(figure) for figure in FIGURES]

    @property
    def details(self) -> str:
        """All other results of a recording that was identified in a batch."""
        return f"{self.folder}/details.zip"

    @property
    def checksums(self) -> str:
        """Checksums of the results that one job has made."""
        return f"{self.folder}/checksums/{IDENTIFICATION}.sha256"

    @property
    def logs(self) -> str:
        """Folder of the logs."""
        return f"{self.folder}/logs"

    @property
    def batch_results(self) -> list[str]:
        """The results of a recording that was identified in a batch."""
        return [
            self.recording_info,
            self.model,
            self.modes,
            self.validation,
            self.summary,
            self.details,
        ]

    def log(self, job: str) -> str:
        """Log of a job."""
        return f"{self.folder}/logs/{job}.log"

    def benchmark(self, job: str) -> str:
        """Time and memory of a job."""
        return f"{self.folder}/benchmarks/{job}.tsv"

    @property
    def results(self) -> list[str]:
        """The results of every data set, without pages and figures."""
        return [
            self.config,
            self.recording_info,
            self.transforms,
            self.spectrum,
            self.spectrum_summary,
            self.candidates,
            self.model,
            self.model_mat,
            self.modes,
            self.frequency_response,
            self.time_response,
            self.validation,
            self.residual_autocorrelation,
            self.cross_correlation,
            self.simulation,
            self.horizons,
            self.summary,
        ]

    @property
    def pages(self) -> list[str]:
        """The report and its figures."""
        return [self.report, *self.figures]


def check_folders(names: Iterable[str]) -> None:
    """Refuse files where the folders of results must be.

    Raises
    ------
    InputError
        Naming the file.
    """
    for folder in (FOLDER, *(DatasetFiles.of_dataset(name).folder for name in names)):
        if Path(folder).is_symlink() and not Path(folder).exists():
            raise InputError(
                folder, "is a link to a folder that does not exist", "make the folder, or the link anew"
            )
        if Path(folder).exists() and not Path(folder).is_dir():
            raise InputError(
                folder, "is a file, and the results need a folder of this name", "move the file"
            )
