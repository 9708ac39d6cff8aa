"""The pages of a data set, of several side by side, and the lists of all data sets."""

import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from urllib.parse import quote

from evopem.config.conditions import Following
from evopem.errors import InputError
from evopem.figures import svg_texts
from evopem.files.atomic import write_parquet, write_table, write_text
from evopem.files.checksums import GENERATOR, check_page, has_mark, write_page
from evopem.models.response_tables import shaped_modes_table
from evopem.report.comparison import build_comparison
from evopem.report.index_page import NOT_COMPARED, build_index
from evopem.report.page import build_report, read_wall_clock
from evopem.report.templates import template_folder
from evopem.results.comparison import Comparison
from evopem.results.damage_index import Compared
from evopem.results.dataset import DatasetResults, read_results, read_whole_results
from evopem.results.fleet import fleet_table, read_entry, without_formulas
from evopem.results.followed_modes import followed_table
from evopem.results.layout import FOLDER, DatasetFiles, lists_of


def commit_of(workflow: Path) -> str:
    """Name the commit that the workflow was checked out at, ``"unknown"`` outside of Git.

    Read by the report and not in a rule: a new commit alone must not make a result out of date.
    """

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", str(workflow), *arguments],
            capture_output=True,
            text=True,
            check=True,
            timeout=20,
        ).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "scripts/run_stage.py")
        commit = git("rev-parse", "HEAD")
        changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", "../Snakefile")
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return f"{commit}, with changes that are not committed" if changed else commit


def write_report(files: DatasetFiles) -> None:
    """Draw every figure of one data set, and set them and the results into one HTML file."""
    results = read_results(files)
    figures = svg_texts(results)
    for name, text in figures.items():
        write_text(files.figure(name), text)
    write_text(files.report, report_page(files, results, figures))


def report_page(files: DatasetFiles, results: DatasetResults, figures: Mapping[str, str]) -> str:
    """The report of results and figures that are at hand."""
    return build_report(
        results,
        figures,
        read_wall_clock(Path(files.folder) / "benchmarks"),
        Path(files.config).read_text(encoding="utf-8"),
        commit_of(template_folder().parent),
    )


def merge_setups(files: DatasetFiles, names: tuple[str, ...], structure: str) -> None:
    """The page of a structure whose set-ups are data sets, and the table of its modes."""
    page = f"{files.folder}/setups/{structure}.html"
    folders = [f"{files.folder}/{name}" for name in names]
    merged = compare_datasets(folders, page, setups=True).merged
    assert merged is not None
    modes = shaped_modes_table(merged.modes, merged.inputs, merged.outputs)
    write_table(f"{files.folder}/setups/{structure}.csv", modes)


def compare_datasets(folders: Sequence[str], page: str, setups: bool = False) -> Comparison:
    """Lay the results of data sets side by side, on a page with links to their reports.

    With ``setups`` they are set-ups of one structure, and their modes are merged.
    """
    check_page(page)  # before the work
    datasets = [DatasetFiles(folder) for folder in folders]
    comparison = Comparison.of(list(map(read_whole_results, datasets)), setups=setups)
    reports = {
        label: quote(Path(os.path.relpath(files.report, Path(page).parent)).as_posix())
        for label, files in zip(comparison.labels, datasets, strict=True)
        if Path(files.report).is_file()
    }
    write_page(page, build_comparison(comparison, reports))
    return comparison


def collect_fleet(
    files: DatasetFiles,
    names: tuple[str, ...],
    page: str,
    following: Following = NOT_COMPARED,
    setups: tuple[str, ...] = (),
) -> None:
    """List data sets, and follow the modes of those whose results are whole.

    ``setups``: structures whose set-ups have a page of their own.
    """
    entries = {name: read_entry(DatasetFiles(f"{files.folder}/{name}")) for name in names}
    index = partial(build_index, entries, page, setups=setups)
    _write_lists(files.folder, Compared(entries, following), index)


def merge_fleets(folders: Sequence[str], target: str) -> None:
    """List the data sets of several folders of results, in lists of their own.

    A data set is called by its name and, where several have this name, by its folder as well.
    """
    folder_of = {path.resolve(): folder for folder in folders for path in _datasets_below(folder)}
    _check_target(Path(target), folder_of)
    tops = {folder: Path(folder).resolve() for folder in folders}
    shared = len(Path(os.path.commonpath(tops.values())).parts)
    groups = {
        folder: "/".join(part for part in top.parts[shared:] if part != FOLDER) or top.name
        for folder, top in tops.items()
    }
    counts = Counter(path.name for path in folder_of)
    entries, places = {}, {}
    for path, folder in folder_of.items():
        name = path.name if counts[path.name] == 1 else f"{path.name} ({groups[folder]})"
        entries[name] = read_entry(DatasetFiles(str(path)))
        address = Path(os.path.relpath(path, Path(target).resolve())).as_posix()
        places[name] = quote(address), groups[folder]
    Path(target).mkdir(parents=True, exist_ok=True)
    index = partial(build_index, entries, places=places)
    _write_lists(target, Compared(entries, NOT_COMPARED), index)


def _datasets_below(folder: str) -> list[Path]:
    """The folders of data sets in a folder of results, which may be one itself."""
    top = Path(folder)
    datasets = {path.parent for path in top.rglob("summary.json")}
    failed = {path.parents[1] for path in top.rglob("logs/*.unfinished.json")}
    datasets |= {path for path in failed if (path / "config.yaml").is_file()}
    if not datasets:
        problem = "holds no results of data sets" if top.is_dir() else "is not a folder"
        raise InputError(folder, problem, f"give folders of results, such as {FOLDER}")
    return sorted(datasets)


def _check_target(target: Path, datasets: Collection[Path]) -> None:
    """Refuse to write lists into a folder that holds anything but such lists."""
    held = any(path.is_relative_to(target.resolve()) for path in datasets)
    replaced = has_mark(target / "index.html", GENERATOR) or not target.exists()
    if held or not (replaced or (target.is_dir() and not any(target.iterdir()))):
        problem = "holds results" if held else "is no folder of such lists"
        raise InputError(str(target), problem, "choose another folder with --to")


def _write_lists(folder: str, compared: Compared, index: Callable[..., str]) -> None:
    for path in lists_of(compared.following):
        _write_list(f"{folder}/{Path(path).name}", compared, index)


def collect_unfinished(
    required: Mapping[str, Collection[str]],
    page: str,
    pending: Collection[str] = (),
    following: Following = NOT_COMPARED,
) -> None:
    """List all data sets after a run that failed, each with its summary or what went wrong.

    Raises no error: it runs when Snakemake has already failed. A list that cannot be written is
    deleted, so that no outdated list remains, and a sentence on standard error says why.
    """
    entries = {
        name: read_entry(DatasetFiles.of_dataset(name), files, name in pending)
        for name, files in required.items()
    }
    compared = Compared(entries, following)
    index = partial(build_index, entries, page)
    for path in lists_of(following):
        try:
            _write_list(path, compared, index)
        except Exception as error:
            sys.stderr.write(f"{path}: the list was not written ({error}).\n")
            with suppress(OSError):
                Path(path).unlink(missing_ok=True)


def _write_list(path: str, compared: Compared, index: Callable[..., str]) -> None:
    match Path(path).name:
        case "index.html":
            following, followed = compared.following, compared.followed
            damage = None if following.reference is None else compared.damage
            said = {"damage": damage, "dependences": compared.dependences}
            write_text(path, index(followed=followed, following=following, **said))
        case "fleet.csv":
            write_table(path, without_formulas(fleet_table(compared.entries)))
        case "fleet.parquet":
            write_parquet(path, fleet_table(compared.entries))
        case "damage_index.csv":
            write_table(path, without_formulas(compared.damage))
        case _:
            write_table(path, without_formulas(followed_table(compared.followed)))
