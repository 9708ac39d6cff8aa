"""Universal File Format, datasets of type 58 (functions at nodal degrees of freedom), by pyuff."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from evopem.arrays import Array, Complex
from evopem.errors import InputError
from evopem.signals.readers.open_file import Channel, Contents, Properties, library, refusing_damage
from evopem.signals.timestamps import timing

_NAME_FIELDS = ("id1", "id2", "id3", "id4", "id5", "rsp_ent_name", "ordinate_axis_lab")
_DIRECTIONS = {1: "X+", -1: "X-", 2: "Y+", -2: "Y-", 3: "Z+", -3: "Z-"}
_TIME_FUNCTIONS = (0, 1)  # general, or not stated; time response
_FREQUENCY_AXIS = 18
_FREQUENCY_RESPONSE, _COHERENCE = 4, 6
_KIND = "universal file"
_REMEDY = "choose a time response, or state frequency: abscissa for frequency responses"


@contextmanager
def opened(path: Path) -> Iterator[Contents]:
    """The time records among the datasets of type 58, by number among these or by name.

    A name is any of the five identification lines, the response entity's name, the ordinate's
    label, or node and direction as in ``12:Z+``.
    """
    file, sets = _functions(path)
    with refusing_damage(path, _KIND):
        names = [_names_of(file.read_sets(index, header_only=True)) for index in sets]
    if not sets:
        remedy = "export the time records as dataset 58"
        raise InputError(str(path), "holds no dataset of type 58", remedy)

    def load(index: int) -> Channel:
        with refusing_damage(path, _KIND):
            dataset = file.read_sets(sets[index])
        return _channel(path, dataset, index + 1, names[index][0])

    yield Contents(path, "dataset", names, load)


def frequency_functions(path: Path) -> dict[tuple[str, str, bool], tuple[Array, Complex, str]]:
    """The frequency responses and coherences among the datasets of type 58.

    Frequencies (Hz), values and unit, by the degrees of freedom of response and reference, such as
    ``12:Z+``, and by whether they are coherences.
    """
    file, sets = _functions(path)
    with refusing_damage(path, _KIND):
        read = [file.read_sets(index) for index in sets]
    functions = {}
    for dataset in read:
        if dataset.get("func_type") in (_FREQUENCY_RESPONSE, _COHERENCE):
            response, reference = (_degree_of_freedom(dataset, end) for end in ("rsp", "ref"))
            unit = str(dataset.get("ordinate_axis_units_lab", "")).strip().replace("NONE", "")
            frequencies, values = np.asarray(dataset["x"], dtype=float), dataset["data"]
            is_coherence = dataset["func_type"] == _COHERENCE
            read_values = frequencies, np.asarray(values, complex), unit
            functions[response, reference, is_coherence] = read_values
    if all(is_coherence for *_, is_coherence in functions):
        problem = "holds no frequency response (dataset 58, function type 4)"
        raise InputError(str(path), problem, "export the responses, or leave out frequency")
    return functions


def _functions(path: Path) -> tuple[Any, list[int]]:
    """A file as pyuff opens it, and the numbers of its datasets of type 58."""
    pyuff = library("pyuff", path)
    _refuse_broken_off(path)
    with refusing_damage(path, _KIND):
        file = pyuff.UFF(str(path))
        return file, [index for index, kind in enumerate(file.get_set_types()) if kind == 58]


def _degree_of_freedom(header: Properties, end: str) -> str:
    """Node and direction of an end of a function, ``rsp`` or ``ref``, such as ``12:Z+``."""
    return f"{header.get(f'{end}_node', 0)}:{_DIRECTIONS.get(header.get(f'{end}_dir', 0), '')}"


def _refuse_broken_off(path: Path) -> None:
    """Refuse a file that does not end with the line -1; pyuff leaves out a dataset without it."""
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - 200))
        end = file.read().rstrip()
    if not end.endswith(b"    -1"):
        problem = (
            "does not end with the line -1 that closes a dataset, so it breaks off or is no"
            " universal file"
        )
        raise InputError(str(path), problem, "copy or export it again")


def _names_of(header: Properties) -> tuple[str, ...]:
    """All names of a dataset, the most telling one first."""
    texts = [str(header.get(field, "")).strip() for field in _NAME_FIELDS]
    names = [text for text in texts if text and text.upper() != "NONE"]
    return (*names, _degree_of_freedom(header, "rsp"))


def _channel(path: Path, dataset: Properties, number: int, name: str) -> Channel:
    place = f'dataset {number} "{name}"'
    values = np.asarray(dataset["data"])
    in_time = dataset.get("abscissa_spec_data_type") != _FREQUENCY_AXIS
    if dataset.get("func_type") not in _TIME_FUNCTIONS or not in_time or np.iscomplexobj(values):
        raise InputError(str(path), "it is no real time record", _REMEDY, place)
    stated = dataset.get("num_pts")
    if stated != values.size:
        problem = f"its header announces {stated} values and {values.size} are there"
        raise InputError(str(path), problem, "copy or export the file again", place)
    problem = ""
    if dataset.get("abscissa_spacing") == 1:
        start, increment = float(dataset["abscissa_min"]), float(dataset["abscissa_inc"])
        rate = 1.0 / increment if 0.0 < increment < np.inf else None
        problem = "" if rate else f"the increment of its abscissa is {increment:g} s"
    else:
        start = float(dataset["x"][0])
        rate = timing(np.asarray(dataset["x"]), str(path), place, unit="s").rate
    unit = str(dataset.get("ordinate_axis_units_lab", "")).strip()
    unit = "" if unit.upper() == "NONE" else unit
    return Channel(name, values, unit, rate, problem, start)
