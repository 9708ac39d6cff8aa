"""HDF5 files, read by h5py."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import ceil, prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.numpy_files import RATE_NAMES, StoredArray, contents_of, in_memory
from evopem.signals.readers.open_file import Contents, Properties, library, refusing_damage

_COMPLEX_FIELDS = ("real", "imag")


def _stored(path: Path, dataset: Any, field: str | None = None) -> StoredArray:
    """A dataset, or one field of its records; a damaged one is refused when it is loaded."""
    dtype = dataset.dtype
    shape = tuple(dataset.shape) + (() if field is None else dtype[field].shape)
    is_complex = dtype.names == _COMPLEX_FIELDS

    def load() -> NDArray[Any]:
        _refuse_incomplete(path, dataset)
        values = np.asarray(dataset[()] if field is None else dataset[field])
        if is_complex:
            values = values["real"] + 1j * values["imag"]
        return _without_missing(path, dataset, values)

    of_elements = dtype if field is None else dtype[field].base
    return StoredArray(shape, np.dtype(np.complex128) if is_complex else of_elements, load)


def _variable(path: Path, dataset: Any) -> StoredArray:
    """A variable of MATLAB, whose dimensions are stored in reverse order."""
    shape, dtype, load = _stored(path, dataset)
    # The numbers of texts and cells stand for something else.
    if dataset.attrs.get("MATLAB_class", b"") in (b"char", b"cell"):
        dtype = np.dtype(object)
    return StoredArray(shape[::-1], dtype, lambda: load().T)


@contextmanager
def opened(path: Path, is_matlab: bool = False) -> Iterator[Contents]:
    """The datasets of a file by their paths, or the variables of a MATLAB file of version 7.3.

    A field of a dataset of records is named ``dataset.field``. Units and rates are attributes.
    """
    h5py = library("h5py", path)
    arrays: dict[str, StoredArray] = {}
    attributes: dict[str, StoredArray] = {}
    units: dict[str, str] = {}
    sparse: list[str] = []

    def collect(name: str, item: Any) -> None:
        attributes.update(_rates_in(item.attrs, f"{name}/"))
        if not isinstance(item, h5py.Dataset) or item.shape is None:
            return
        units[name] = _unit(item.attrs)
        if item.dtype.names is None or item.dtype.names == _COMPLEX_FIELDS:
            arrays[name] = _stored(path, item)
            return
        for field in item.dtype.names:
            arrays[f"{name}.{field}"] = _stored(path, item, field)

    def collect_variable(name: str, item: Any) -> None:
        # Groups with a number sign hold the contents of cells and objects.
        if name.startswith("#") or any(name.startswith(group) for group in sparse):
            return
        if "MATLAB_sparse" in item.attrs:
            sparse.append(f"{name}/")
        # An empty variable is stored as the lengths of its dimensions.
        if isinstance(item, h5py.Dataset) and not item.attrs.get("MATLAB_empty", 0):
            arrays[name.replace("/", ".")] = _variable(path, item)

    kind = "MATLAB 7.3 file" if is_matlab else "HDF5 file"
    with refusing_damage(path, kind), h5py.File(path, "r") as file:
        attributes.update(_rates_in(file.attrs))
        file.visititems(collect_variable if is_matlab else collect)
        listed = "variable" if is_matlab else "dataset"
        yield contents_of(path, arrays, listed, units, attributes)


def _rates_in(attributes: Properties, prefix: str = "") -> dict[str, StoredArray]:
    return {
        f"{prefix}{name}": in_memory(np.asarray(attributes[name]))
        for name in attributes
        if name.lower() in RATE_NAMES
    }


def _unit(attributes: Properties) -> str:
    for name in attributes:
        if name.lower() not in ("unit", "units"):
            continue
        value = attributes[name]
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.reshape(-1)[0]
        if isinstance(value, bytes):
            value = value.decode("utf-8", errors="replace")
        if isinstance(value, str):
            return value
    return ""


def _refuse_incomplete(path: Path, dataset: Any) -> None:
    """Refuse a dataset whose values are not all written, or not all in this file. HDF5 gives the
    fill value, mostly 0, for what was never written and for virtual datasets whose source is
    missing. Values in other files are not covered by the file's checksum."""
    problem = ""
    if dataset.external:
        problem = f'its values are stored in another file, "{dataset.external[0][0]}"'
    elif dataset.is_virtual:
        for source in dataset.virtual_sources():
            if source.file_name != ".":
                problem = f'its values are stored in another file, "{source.file_name}"'
            elif source.dset_name not in dataset.file:
                problem = f'its source "{source.dset_name}" is missing'
    elif dataset.size and dataset.chunks:
        counts = zip(dataset.shape, dataset.chunks, strict=True)
        expected = prod(ceil(length / chunk) for length, chunk in counts)
        written = dataset.id.get_num_chunks()
        if written < expected:
            problem = f"only {written} of its {expected} chunks were written"
    elif dataset.size and not dataset.id.get_storage_size():
        problem = "its values were never written"
    if problem:
        remedy = "copy the whole recording into one file"
        raise InputError(str(path), problem, remedy, f'dataset "{dataset.name.lstrip("/")}"')


def _without_missing(path: Path, dataset: Any, values: NDArray) -> NDArray:
    """The values with NaN where the conventions of netCDF mark them as missing."""
    attributes = dataset.attrs
    for name, neutral in (("scale_factor", 1.0), ("add_offset", 0.0)):
        if name in attributes and np.any(np.asarray(attributes[name]) != neutral):
            problem = f"its values are packed: the attribute {name} is {attributes[name]}"
            remedy = "store the values in their unit"
            raise InputError(str(path), problem, remedy, f'dataset "{dataset.name.lstrip("/")}"')
    for name in ("_FillValue", "missing_value"):
        if name in attributes and values.dtype.kind in "fiu":
            missing = np.isin(values, np.asarray(attributes[name]))
            values = np.where(missing, np.nan, values) if missing.any() else values
    return values
