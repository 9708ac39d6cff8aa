"""The command ``evopem``: one system from the terminal, or a configuration for many."""

import argparse
import errno
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import yaml

from evopem.config.configuration import check_environment, job_environment
from evopem.config.defaults import complete, read_settings
from evopem.config.keys import COLUMNS, SOURCE, one_or_list
from evopem.config.schema import in_words
from evopem.config.settings import DatasetSettings
from evopem.config.source_checks import RESULTS_FOLDER
from evopem.config.strict_yaml import Keys, check_yaml_files
from evopem.errors import FOR_REPORT, InputError, check_packages
from evopem.files.checksums import COMMAND, sha256_of_file
from evopem.files.job import job, only_run
from evopem.pipeline.identification import ProgressLine
from evopem.results.identity import origins
from evopem.results.layout import DatasetFiles, check_folders
from evopem.version import __version__

_OPTIONS = {  # how the keys that a remedy names are given to this command
    "uneven_time: interpolate": "--uneven-time interpolate",
    "frequency: abscissa": "--frequency abscissa",
    'decimal_mark: ","': "--decimal-mark ,",
    'decimal_mark: "."': "--decimal-mark .",
    "sampling_rate": "--rate",
    "time_unit": "--time-unit",
    "header_lines": "--header-lines",
}
_DESCRIPTION = """\
Identify a dynamic system from a recording of its inputs and outputs: a model, natural frequencies
and damping ratios with standard errors, and a report that says how far to trust them.
"""
_EPILOG = """\
examples:
  evopem data.csv      where names, or a test, tell input and output
  evopem data.csv --input u --output y --rate 100
  evopem bench.mat --input iq_adx --output omega_max --rate 2500
  evopem log.csv --input 2 --output 3 --time 1
  evopem beam.uff --input force --output 'acc_*'      several channels: mode shapes as well
  evopem frf.uff --input '*' --output '*' --frequency abscissa      frequency responses
  evopem blow_*.csv --input force --output 'acc_*'      several recordings: one model of all
  evopem init measurements      write measurements/config.yaml for many recordings
  evopem compare results/a results/b      lay results side by side on one page
  evopem merge monday/results tuesday/results      list the data sets of several folders on one page
  evopem export results/a/model.json --c      write the model as C code

The results lie in results/<name of the first file>/; open report.html first. A file may be text,
.mat, .npz, .npy, .parquet, .h5, .tdms or .uff.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit code is 0, 1 for input that cannot be used (said in one sentence),
    2 for wrong arguments, 130 when it was interrupted.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        # A terminal that has no minus sign or narrow space shows a question mark instead.
        with suppress(AttributeError):
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]
    try:
        _check_working_directory()
        commands = {"init": _init, "compare": _compare, "merge": _merge, "export": _export}
        command = commands.get(given[0]) if given else None
        return command(given[1:]) if command else _identify(_parsed(given))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write("\ninterrupted\n")
        return 130
    except BrokenPipeError:  # `evopem … | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:  # a job says itself what it cannot read or write
        if error.errno not in (errno.ENAMETOOLONG, errno.EACCES):
            raise
        refused = InputError(error.filename, str(error.strerror).lower(), "give another path")
        sys.stderr.write(f"{refused}\n")
        return 1


def _check_working_directory() -> None:
    try:
        Path.cwd()
    except OSError:
        problem = "the folder that this terminal is in no longer exists"
        raise InputError("evopem", problem, "change to another one") from None


def _parsed(given: Sequence[str]) -> argparse.Namespace:
    """Parse the arguments; of a second channel behind one option is said how it is given."""
    parser = argparse.ArgumentParser(
        "evopem",
        usage="evopem FILE … [--input CHANNEL … --output CHANNEL … --rate HZ | --time CHANNEL]\n"
        "       evopem FOLDER\n"
        "       evopem init [FOLDER]\n"
        "       evopem compare FOLDER FOLDER … [--setups] [--page FILE]\n"
        "       evopem merge FOLDER … [--to FOLDER]\n"
        "       evopem export MODEL [--c [FOLDER]] [--fmu FILE]",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add, rate = parser.add_argument, parser.add_mutually_exclusive_group()
    channel: Keys = {
        "type": lambda text: int(text) if text.isascii() and text.isdigit() else text,
        "metavar": "CHANNEL",
    }
    add("--version", action="version", version=f"evopem {__version__}")
    add("file", metavar="FILE", nargs="+", help="the recording, or several of one system")
    several = "For a list, repeat the option"
    for role in ("input", "output"):
        add(f"--{role}", action="append", help=f"{in_words(SOURCE[role])}. {several}", **channel)
    about = in_words(SOURCE["sampling_rate"])
    rate.add_argument("--rate", type=float, metavar="HZ", help=about)
    rate.add_argument("--time", help=in_words(SOURCE["time"]), **channel)
    for key, form in {
        "frequency": channel,
        "uneven_time": {"choices": ["interpolate"]},
        "time_unit": {"metavar": "UNIT"},
        "header_lines": {"type": int, "metavar": "N"},
        "decimal_mark": {"choices": [".", ","]},
    }.items():
        add(f"--{key.replace('_', '-')}", help=in_words(SOURCE[key]), **form)
    about = "where the folder of the results is made (default: %(default)s)"
    add("--results", default=RESULTS_FOLDER, metavar="FOLDER", help=about)
    about = "a config.yaml whose `defaults:` decide what they name"
    add("--config", metavar="YAML", help=about)
    add("--json", action="store_true", help="print verdict.json, for programs, and nothing else")
    for argument in given:
        if argument.startswith("-") and os.path.exists(argument):  # noqa: PTH110 - of any length
            raise InputError(argument, "begins with -, as options do", f"write ./{argument}")
    arguments, left = parser.parse_known_args(given)
    for option, _, second in zip(given, given[1:], given[2:], strict=False):
        of_channel = option in ("--input", "--output") and not second.startswith("-")
        if left and of_channel and second == left[0]:
            parser.error(
                f"{second} stands without an option: write {option} before each channel, as in"
                f" {option} 2 {option} 3, or give a pattern in quotation marks, as in {option}"
                " 'acc_*'; further files stand before the first option"
            )
    if left:
        parser.error(f"unrecognized arguments: {' '.join(left)}")
    missing = [role for role in ("input", "output") if not vars(arguments)[role]]
    if len(missing) == 1 or (missing and arguments.frequency is not None):
        none = ", or write --input none where only outputs were recorded"
        parser.error(f"--{missing[0]} is missing: name it{none if missing[0] == 'input' else ''}")
    return arguments


def _init(given: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        "evopem init",
        description="Write a commented config.yaml for a folder of recordings by looking into "
        "them: channels, times and sampling rates. An existing one is not overwritten.",
    )
    parser.add_argument("folder", nargs="?", default=".", metavar="FOLDER", help="default: here")
    folder = parser.parse_args(given).folder
    # Readers need numpy, which the rest of this module does not.
    from evopem.terminal.new_configuration import write_configuration

    written = write_configuration(folder)
    print(f"Wrote {written}: check the inputs, outputs and sampling rates in it.")
    return 0


def _folder(folder: str) -> int:
    """Say what would be taken from each recording of a folder."""
    from evopem.terminal.new_configuration import configuration_text

    print(configuration_text(Path(folder)))
    print(f"# Nothing was written: evopem init {folder} writes this as {folder}/config.yaml.")
    return 0


def _compare(given: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        "evopem compare",
        description="Lay the results of two to six data sets side by side: errors and verdicts, "
        "frequency responses over each other, modes matched by frequency, and checks.",
    )
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help="results, such as results/arm")
    about = "default: %(default)s"
    parser.add_argument("--page", default="comparison.html", metavar="FILE", help=about)
    about = "they are set-ups of one structure with common channels: merge their modes"
    parser.add_argument("--setups", action="store_true", help=about)
    arguments = parser.parse_args(given)
    _prepare("the figures and the page")
    from evopem.pipeline.report import compare_datasets
    from evopem.report.comparison import comparison_text
    from evopem.report.results_text import show

    comparison = compare_datasets(arguments.folders, arguments.page, arguments.setups)
    show(f"{comparison_text(comparison)}\n\n  page  {arguments.page}")
    return 0


def _merge(given: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        "evopem merge",
        description="List the data sets of several folders of results on one page, with one table "
        "of all modes and checks, and follow the modes of recordings with like names.",
    )
    about = "results, or a folder with several such folders"
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help=about)
    about = "where index.html and the tables are written; default: %(default)s"
    parser.add_argument("--to", default="merged", metavar="FOLDER", help=about)
    arguments = parser.parse_args(given)
    _prepare("the page")
    from evopem.pipeline.report import merge_fleets

    merge_fleets(arguments.folders, arguments.to)
    print(f"Wrote {arguments.to}/index.html.")
    return 0


def _export(given: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        "evopem export",
        description="Write a model for other programs: simulation and one-step prediction in C99, "
        "simulation as a functional mock-up unit (FMI 3.0, co-simulation); signals in the units of "
        "the recording. Files that are not of evopem are not overwritten.",
    )
    parser.add_argument("model", metavar="MODEL", help="the model.json of results")
    about = "write NAME.c and NAME.h; default: here"
    parser.add_argument("--c", nargs="?", const=".", metavar="FOLDER", help=about)
    about = "write an FMU with source and, where there is a C compiler, a binary"
    parser.add_argument("--fmu", metavar="FILE", help=about)
    arguments = parser.parse_args(given)
    if arguments.c is None and arguments.fmu is None:
        parser.error("give --c, --fmu or both")
    from evopem.exports.c_code import export_c
    from evopem.exports.fmu import export_fmu

    if arguments.c is not None:
        source, header = export_c(arguments.model, arguments.c)
        print(f"Wrote {source} and {header}, which says how it is called.")
    if arguments.fmu is not None:
        missing = export_fmu(arguments.model, arguments.fmu)
        print(f"Wrote {arguments.fmu}{f' without a binary: {missing}' if missing else ''}.")
    return 0


def _prepare(purpose: str) -> None:
    """Check packages and environment, and set the variables that numpy reads at its import."""
    check_packages(FOR_REPORT, "evopem", purpose)
    check_environment(os.environ)
    os.environ.update(job_environment(os.environ, Path.cwd()))


@contextmanager
def _options_for_keys(name: str) -> Iterator[None]:
    """An error about a data set names options where it names keys of a configuration."""
    try:
        yield
    except InputError as error:
        remedy = error.remedy
        for key, option in _OPTIONS.items():
            remedy = remedy.replace(key, option)
        source, key = error.source, error.place.removeprefix(f"datasets.{name}.")
        if key == error.place:
            raise InputError(source, error.problem, remedy, key) from None
        option = ({"file": "FILE"} | _OPTIONS).get(key, f"--{key.replace('_', '-')}")
        raise InputError(option, error.problem, remedy) from None


def _identify(arguments: argparse.Namespace) -> int:
    _prepare("the validation and the report")
    if Path(arguments.file[0]).is_dir():
        return _folder(arguments.file[0])
    settings = _settings(arguments)
    files = DatasetFiles(str(Path(arguments.results) / settings.name))
    _check_folder(files, settings)
    from evopem.pipeline.identification import identify_dataset, made_aside, put_in_place
    from evopem.pipeline.planning.stages import results_of
    from evopem.report.results_text import dataset_text, show

    progress = ProgressLine(sys.stderr, sys.stderr.isatty())
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    outputs = results_of(settings, files, with_report=True)
    try:
        with only_run(files.folder), job(files.log(COMMAND), (), outputs, False) as logger:

            def log(words: str) -> None:
                logger.info(words)
                progress.tell(words)

            with made_aside(files) as made:
                with _options_for_keys(settings.name):
                    identify_dataset(made, settings, True, log, cores, progress.announce)
                put_in_place(made, files)
    finally:
        progress.close()
    written = Path(files.verdict).read_text(encoding="utf-8") if arguments.json else ""
    show(written.rstrip() or dataset_text(files, files.report))
    return 0


def _settings(arguments: argparse.Namespace) -> DatasetSettings:
    """The settings that a data set of these keys has in a configuration."""
    from evopem.terminal.new_configuration import certain_channels, dataset_name

    if not arguments.input:
        taken, sentence = certain_channels(arguments.file[0])
        sys.stderr.write(f"{sentence}\n")
        vars(arguments).update(taken | {"time": arguments.time or taken["time"]})
        arguments.time = None if arguments.rate else arguments.time
    given = vars(arguments) | {"sampling_rate": arguments.rate}
    keys = {key: one_or_list(given[key]) for key in ("file", "input", "output")}
    keys |= {key: given[key] for key in COLUMNS if given[key] is not None}
    name = dataset_name(Path(arguments.file[0]))
    content: Keys = {"datasets": {name: keys}}
    if arguments.config is not None:
        if not Path(arguments.config).exists():
            remedy = "correct the path after --config"
            raise InputError(arguments.config, "there is no such file", remedy)
        check_yaml_files([arguments.config])
        written = yaml.safe_load(Path(arguments.config).read_text(encoding="utf-8"))
        if "defaults" not in written:
            remedy = "write the keys of the analysis under `defaults:`"
            raise InputError(arguments.config, "it has no `defaults:`, which alone count", remedy)
        content |= {key: value for key, value in written.items() if key == "defaults" and value}
    with _options_for_keys(name):
        return complete(content, arguments.config or "evopem").datasets[name]


def _check_folder(files: DatasetFiles, settings: DatasetSettings) -> None:
    """Refuse to overwrite the results of another recording."""
    folder = Path(files.folder)
    check_folders([folder, *folder.parents])
    # A run that did not end left nothing that is worth keeping.
    if not (Path(files.config).exists() and Path(files.report).exists()):
        return
    held: tuple[str, ...] = ()
    with suppress(InputError):
        held = read_settings(files.config).source.all_files
    given = settings.source.all_files
    # In the working directory, the same name is the same file, whatever it holds now. Elsewhere
    # another project may have made the results, from another file of that name.
    here = folder.resolve().is_relative_to(Path.cwd()) or all(map(os.path.isabs, held))
    same_names = [*map(os.path.abspath, held)] == [*map(os.path.abspath, given)]
    digests = [origin.get("sha256") for origin in origins(files.recording_info).values()]
    if not (same_names and here) and digests != [*map(sha256_of_file, given)]:
        problem = f"it holds the results of {', '.join(held) or 'another recording'}"
        raise InputError(str(folder), problem, "choose another folder with --results")
