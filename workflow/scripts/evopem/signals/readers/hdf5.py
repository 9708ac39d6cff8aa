"""HDF5 files, read by h5py."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, prod
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.arrays import RATE_NAMES, channels_of, names_of
from evopem.signals.readers.channels import Channel, Reference, library, refuse_unreadable

T = TypeVar("T")

_COMPLEX_FIELDS = ("real", "imag")


@dataclass(frozen=True)
class StoredDataset:
    """A dataset, or one field of its records, that is read when it is asked for."""

    path: Path  # the file that an error names
    dataset: Any
    field: str | None = None  # A field of a dataset of records
    transposed: bool = False  # whether the dimensions are stored in reverse order, as MATLAB does
    # false for numbers that stand for something else, such as the codes of characters
    is_numeric: bool = True

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the dimensions."""
        stored = self.dataset.dtype
        inner = () if self.field is None else stored[self.field].shape
        shape = tuple(self.dataset.shape) + inner
        return shape[::-1] if self.transposed else shape

    @property
    def dtype(self) -> np.dtype:
        """Type of the elements."""
        dtype = self.dataset.dtype
        if not self.is_numeric:
            return np.dtype(object)
        if dtype.names == _COMPLEX_FIELDS:
            return np.dtype(np.complex128)
        return dtype if self.field is None else dtype[self.field].base

    def __getitem__(self, index: tuple[()]) -> NDArray[Any]:
        """All values."""
        refuse_incomplete(self.path, self.dataset)
        values = np.asarray(self.dataset[()] if self.field is None else self.dataset[self.field])
        if values.dtype.names == _COMPLEX_FIELDS:
            values = values["real"] + 1j * values["imag"]
        _refuse_missing(self.path, self.dataset, values)
        return values.T if self.transposed else values


def read(path: Path, references: Sequence[Reference]) -> list[Channel]:
    """Read datasets by their path in the file, or by number in the order of the paths.

    A field of a dataset of records is named ``dataset.field``. The attribute ``unit`` or
    ``units`` of a dataset is its unit. The sampling rate is a single-number dataset or an
    attribute named as in `RATE_NAMES`, of the dataset or of a group around it.
    """
    wanted = [one.lstrip("/") if isinstance(one, str) else one for one in references]
    return _in_file(
        path,
        lambda arrays, units, attributes: channels_of(
            path, arrays, wanted, "dataset", units, attributes
        ),
    )


def names(path: Path) -> list[str]:
    """Paths of all channels in the order of their numbers."""
    return _in_file(path, lambda arrays, *_: names_of(arrays))


def _in_file(
    path: Path, use: Callable[[dict[str, StoredDataset], dict[str, str], dict[str, Any]], T]
) -> T:
    """Call a function with the datasets, units and rates of a file while it is open."""
    h5py = library("h5py", path)
    try:
        file = h5py.File(path, "r")
    except OSError:
        refuse_unreadable(path, "HDF5 file")
    with file:
        arrays: dict[str, StoredDataset] = {}
        attributes = dict(_rates_in(file.attrs))
        units: dict[str, str] = {}

        def collect(name: str, item: Any) -> None:
            attributes.update(_rates_in(item.attrs, f"{name}/"))
            if not isinstance(item, h5py.Dataset) or item.shape is None:
                return
            units[name] = _unit(item.attrs)
            if item.dtype.names is None or item.dtype.names == _COMPLEX_FIELDS:
                arrays[name] = StoredDataset(path, item)
                return
            for field in item.dtype.names:
                arrays[f"{name}.{field}"] = StoredDataset(path, item, field)

        try:
            file.visititems(collect)
            return use(arrays, units, attributes)
        except InputError:
            raise
        except Exception:
            # h5py meets damage with OSError, RuntimeError, KeyError, TypeError, ValueError …
            refuse_unreadable(path, "HDF5 file")


def _rates_in(attributes: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    return {
        f"{prefix}{name}": np.asarray(attributes[name])
        for name in attributes
        if name.lower() in RATE_NAMES
    }


def _unit(attributes: Mapping[str, Any]) -> str:
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


def refuse_incomplete(path: Path, dataset: Any) -> None:
    """Refuse a dataset whose values are not all written, or not all in this file.

    HDF5 gives the fill value, mostly 0, for what was never written and for virtual datasets
    whose source is missing. Values in other files are not covered by the file's checksum.
    """
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
        raise InputError(
            str(path),
            problem,
            "copy the whole recording into one file",
            f'dataset "{dataset.name.lstrip("/")}"',
        )


def _refuse_missing(path: Path, dataset: Any, values: NDArray) -> None:
    """Refuse what the conventions of netCDF mark as packed or as missing."""
    attributes = dataset.attrs
    place = f'dataset "{dataset.name.lstrip("/")}"'
    for name, neutral in (("scale_factor", 1.0), ("add_offset", 0.0)):
        if name in attributes and np.any(np.asarray(attributes[name]) != neutral):
            raise InputError(
                str(path),
                f"its values are packed: the attribute {name} is {attributes[name]}",
                "store the values in their unit",
                place,
            )
    for name in ("_FillValue", "missing_value"):
        if name in attributes and values.dtype.kind in "fiu":
            missing = np.isin(values, np.asarray(attributes[name]))
            if missing.any():
                first = int(np.argmax(missing.any(axis=tuple(range(1, values.ndim)))))
                raise InputError(
                    str(path),
                    f"the value is missing, marked by {name}",
                    "repair the recording or cut that part away",
                    f"{place}, sample {first + 1}",
                )
