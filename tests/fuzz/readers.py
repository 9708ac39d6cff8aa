"""Coverage-guided fuzzing of the readers, by atheris; see `make fuzz`.

    python tests/fuzz/readers.py [folder] [libFuzzer options]

It starts from a small valid recording in every format and from the inputs that are kept in
``corpus``. Any exception other than `InputError` stops it; the input is written to ``crash-…``.
"""

import logging
import sys
import tempfile
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[2] / "workflow" / "scripts"))
sys.path.insert(0, str(Path(__file__).parent))
INSTRUMENTED = ("evopem.signals", "nptdms", "pyuff", "numpy.lib", "zipfile", "scipy.io.matlab")

with atheris.instrument_imports(include=list(INSTRUMENTED)):
    import nptdms  # noqa: F401
    import pyuff  # noqa: F401
    from targets import read_bytes, seeds

    import evopem.signals.readers.hdf5
    import evopem.signals.readers.matlab
    import evopem.signals.readers.numpy_files
    import evopem.signals.readers.parquet
    import evopem.signals.readers.tdms
    import evopem.signals.readers.text
    import evopem.signals.readers.uff  # noqa: F401

KEPT = Path(__file__).parent / "corpus"


def main() -> None:
    """Fuzz until a limit is reached, such as ``-max_total_time=600`` or ``-runs=100000``."""
    logging.disable(logging.CRITICAL)
    options = sys.argv[1:]
    in_memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    scratch = Path(tempfile.mkdtemp(prefix="evopem-fuzz-", dir=in_memory))
    corpus = scratch / "corpus"
    if options and not options[0].startswith("-"):
        corpus = Path(options.pop(0))
    corpus.mkdir(parents=True, exist_ok=True)
    for name, data in seeds().items():
        (corpus / name).write_bytes(data)
    # libFuzzer writes new inputs to the first folder and only reads the second.
    limits = ["-max_len=6000", "-rss_limit_mb=4000", "-timeout=20"]
    arguments = [sys.argv[0], str(corpus), str(KEPT), *limits, *options]
    atheris.Setup(arguments, lambda data: read_bytes(data, scratch))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
