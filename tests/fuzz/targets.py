"""The function that is fuzzed, which reads bytes as a recording, and the initial inputs."""

import io
import tempfile
import warnings
from pathlib import Path

import numpy as np

from evopem.config.channels import ChannelSettings
from evopem.errors import InputError
from evopem.signals.measured_files import FORMATS
from evopem.signals.reading import read_measured

LATER = (".mdf", ".mf4", ".wav")
# The first byte of a file of the corpus counts on this order.
EXTENSIONS = [*sorted(set(FORMATS).difference(LATER)), *LATER]
CHANNELS = ((1, 2, None), (1, 2, 3), ("u", "y", None), ("u", "y", "y_time"))
SAMPLES = 12


def read_bytes(data: bytes, folder: Path) -> bool:
    """Read bytes as a recording; the first byte chooses the format, the second the channels.

    Returns whether they were a recording. An `InputError` is a valid refusal; any other exception,
    or a refusal that is no single line about the file, is a fault of the reader.
    """
    if len(data) < 2:
        return False
    file = folder / f"recording{EXTENSIONS[data[0] % len(EXTENSIONS)]}"
    file.write_bytes(data[2:])
    input_, output, time = CHANNELS[data[1] % len(CHANNELS)]
    rate = None if data[1] & 4 else 100.0
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            channels = ChannelSettings((input_,), (output,), sampling_rate=rate, time=time)
            recording = read_measured(file, channels)[0]
        except InputError as refusal:
            if "\n" in str(refusal) or not str(refusal).startswith(str(file)):
                raise ValueError(
                    f"the refusal is no single line about the file: {refusal}"
                ) from refusal
            return False
    assert np.isfinite(recording.input).all()
    assert recording.input.shape == recording.output.shape
    assert recording.sampling_rate > 0
    return True


def seeds() -> dict[str, bytes]:
    """A small valid recording in every format, after the two bytes that `read_bytes` expects."""
    time = np.arange(SAMPLES) / 100.0
    u, y = np.random.default_rng(1).standard_normal((2, SAMPLES)).round(3)
    table = np.column_stack([u, y, time])
    comma = "u,y,y_time\n" + "\n".join(",".join(map(str, row)) for row in table)
    contents = {
        ".csv": comma.encode(),
        ".tsv": comma.replace(",", "\t").encode("utf-16"),
        ".txt": comma.replace(",", ";").replace(".", ",").encode("latin-1"),
        ".dat": "\n".join(" ".join(map(str, row)) for row in table).encode(),
        ".asc": ("# u y y_time\n" + "\n".join(f"{a:e} {b} {c}" for a, b, c in table)).encode(),
        ".mat": _matlab(u=u, y=y, y_time=time),
        ".npz": _numpy(u=u, y=y, y_time=time),
        ".npy": _numpy_alone(table),
        ".parquet": _parquet(u=u, y=y, y_time=time),
        ".h5": _hdf5(u=u, y=y, y_time=time),
        ".tdms": _tdms(u=u, y=y, y_time=time),
        ".uff": _uff(u, y),
        ".wav": _wav(table),
    }
    found = {}
    for extension, content in contents.items():
        for channels in range(2 * len(CHANNELS)):
            name = f"seed{extension.replace('.', '-')}-{channels}"
            found[name] = bytes([EXTENSIONS.index(extension), channels]) + content
    return found


def _wav(table: np.ndarray) -> bytes:
    from scipy.io import wavfile

    stream = io.BytesIO()
    wavfile.write(stream, 100, table)
    return stream.getvalue()


def _matlab(**arrays: np.ndarray) -> bytes:
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, arrays)
    return stream.getvalue()


def _numpy(**arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def _numpy_alone(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def _parquet(**arrays: np.ndarray) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    stream = io.BytesIO()
    pq.write_table(pa.table(arrays), stream)
    return stream.getvalue()


def _hdf5(**arrays: np.ndarray) -> bytes:
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        for name, array in arrays.items():
            file[name] = array
    return stream.getvalue()


def _tdms(**arrays: np.ndarray) -> bytes:
    import nptdms

    stream = io.BytesIO()
    with nptdms.TdmsWriter(stream) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("bench", name, array) for name, array in arrays.items()]
        )
    return stream.getvalue()


def _uff(*signals: np.ndarray) -> bytes:
    import pyuff

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "two.uff"
        writer = pyuff.UFF(str(file))
        for number, signal in enumerate(signals, start=1):
            dataset = pyuff.prepare_58(
                func_type=1, rsp_node=1, rsp_dir=1, ref_node=1, ref_dir=1, binary=0,
                id1="uy"[number - 1], data=signal, x=np.arange(signal.size) / 100.0,
                abscissa_spacing=1, abscissa_spec_data_type=17,
                ordinate_spec_data_type=12, orddenom_spec_data_type=0,
            )  # fmt: skip
            writer.write_sets(dataset, "add")
        return file.read_bytes()
