"""A model as a functional mock-up unit (FMU): FMI 3.0 for co-simulation, with its source."""

import hashlib
import platform
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from evopem.arrays import Flags
from evopem.errors import InputError, checked_path
from evopem.exports.c_code import Context, Exported, c_texts, printed, rendered
from evopem.files.atomic import files_below, member_of, pack, write_text
from evopem.files.checksums import check_own
from evopem.models.polynomial import Model, PolynomialModel

_DESCRIPTION = "modelDescription.xml"
_MARK = b'generationTool="evopem'
_COMPILE = ("cc", "-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden")
_MACHINES = {"x86_64", "aarch64"}


def export_fmu(model: str | Path | Model, file: str | Path) -> str:
    """Write a model, or that of a ``model.json`` in recorded units, as an FMU for simulation.

    Its steps last a sampling interval.  Only another unit of evopem is replaced.

    Returns
    -------
    str
        Empty, or why the unit has its source alone and no binary for this computer.

    Raises
    ------
    InputError
        When the model has no input, and as :func:`export_c`.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import evopem
    >>> from evopem.files.atomic import member_of
    >>> with TemporaryDirectory() as folder:
    ...     file = f"{folder}/model.fmu"
    ...     missing = evopem.export_fmu(evopem.PolynomialModel([1.0, -0.5], [2.0], nk=1), file)
    ...     member_of(file, "sources/fmi3.c") is not None
    True
    """
    exported, target = Exported.of(model), checked_path("export", file)
    if not exported.model.inputs:
        problem = "the model has no input that a simulation could respond to"
        raise InputError(exported.source, problem, "export its predictions to C instead")
    check_own(target, "FMU of evopem", lambda at: _MARK in (member_of(at, _DESCRIPTION) or b""))
    texts = {f"sources/{name}": text for name, text in c_texts(exported).items()}
    token = hashlib.sha256("".join(texts.values()).encode()).hexdigest()
    templates = {_DESCRIPTION: "modelDescription.xml.j2", "sources/fmi3.c": "fmi3.c.j2"}
    templates["sources/buildDescription.xml"] = "buildDescription.xml.j2"
    texts |= rendered(exported, templates, token=token, **_variables(exported))
    with TemporaryDirectory() as folder:
        for name, text in texts.items():
            write_text(Path(folder) / name, text)
        missing = _compile(Path(folder), exported.name)
        pack(target, files_below(folder, ""), folder)
    return missing


def _variables(exported: Exported) -> Context:
    """Names, units and start values; outputs depend on the inputs that act on the same sample."""
    signals = exported.signals
    channels = signals.inputs + signals.outputs
    names = [printed(channel.name) for channel in channels]
    if len({*names, "time"}) <= len(names):
        names = [f"{k} {name}" for k, name in enumerate(names, start=1)]
    start = signals.start if signals.has_trend else 0.0
    direct = [1 + np.flatnonzero(acts) for acts in _feedthrough(exported.model)]
    dependencies = [*[()] * len(signals.inputs), *direct]
    variables = [
        {
            "name": name,
            "unit": printed(channel.unit),
            "reference": k,
            "causality": "input" if k <= len(signals.inputs) else "output",
            "start": channel.last[0] if channel.last else channel.level + channel.trend * start,
            "dependencies": dependencies[k - 1],
        }
        for k, (name, channel) in enumerate(zip(names, channels, strict=True), start=1)
    ]
    units = dict.fromkeys(variable["unit"] for variable in variables if variable["unit"])
    starts = [variable["start"] for variable in variables[: len(signals.inputs)]]
    return {"variables": variables, "units": [*units], "starts": starts, "begin": start}


def _feedthrough(model: Model) -> Flags:
    """Whether each input acts on each output in the same sample, (ny, nu)."""
    if isinstance(model, PolynomialModel):
        return np.array([[model.delayed_b(i)[0] != 0.0 for i in range(model.inputs)]])
    return np.asarray((model.D != 0.0) & (np.array(model.delays) == 0))


def _compile(folder: Path, name: str) -> str:
    """Compile the binary for this computer; why there is none, or nothing."""
    if platform.system() != "Linux" or platform.machine() not in _MACHINES:
        return "binaries are made on Linux for x86_64 and aarch64 only"
    if shutil.which(_COMPILE[0]) is None:
        return f"there is no C compiler, {_COMPILE[0]}"
    binaries = folder / "binaries" / f"{platform.machine()}-linux"
    binaries.mkdir(parents=True)
    files = ("-o", f"../{binaries.relative_to(folder)}/{name}.so", f"{name}.c", "fmi3.c", "-lm")
    run = subprocess.run(
        [*_COMPILE, *files], cwd=folder / "sources", capture_output=True, check=False
    )
    return f"{_COMPILE[0]} could not compile it" if run.returncode else ""
