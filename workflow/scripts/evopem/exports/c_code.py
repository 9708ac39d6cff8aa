"""A model as C99: a file and its header, which need nothing but ``math.h``."""

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill, indent
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array, Complex
from evopem.config.schema import shipped
from evopem.errors import InputError, check_packages, checked_path
from evopem.estimation.model_record import ModelRecord, read_model
from evopem.exports.signals import Signals
from evopem.files.atomic import write_text
from evopem.files.checksums import check_own, has_mark
from evopem.models.polynomial import Model, PolynomialModel
from evopem.models.polynomial_roots import roots
from evopem.models.state_space import StateSpaceModel
from evopem.version import __version__

if TYPE_CHECKING:
    from jinja2 import Environment

Context = dict[str, Any]  # what a template is given, by name

_MARK = "Written by evopem"
_WIDTH = 96
_FADED = 0.01
_HEADERS = {
    *("assert", "complex", "ctype", "errno", "fenv", "float", "fmi3", "inttypes", "iso646"),
    *("limits", "locale", "math", "setjmp", "signal", "stdarg", "stdbool", "stddef", "stdint"),
    *("stdio", "stdlib", "string", "tgmath", "time", "wchar", "wctype"),
}
_SMALLEST_BOX_COX = 1e-19  # below it, SciPy's transform is the logarithm


@dataclass(frozen=True, eq=False)
class Exported:
    """A model, its signals, and what it is called in C."""

    model: Model
    signals: Signals
    name: str  # an identifier
    source: str  # the file
    text: str  # the model in a few words
    poles: Complex  # of the plant

    @classmethod
    def of(cls, source: str | Path | Model) -> Self:
        """A model, or that of a ``model.json`` with its transforms; or InputError."""
        if isinstance(source, PolynomialModel | StateSpaceModel):
            return cls._of_model(source, "model", "a model")
        path = checked_path("export", source)
        read = read_model(path)
        first, *purpose = path.stem.split(".")
        if first == "model":
            first = path.absolute().parent.name
        name = identifier("_for_".join([first, *purpose]))
        if not isinstance(read, ModelRecord):
            return cls._of_model(read, name, str(path))
        try:
            signals = Signals.of_record(read)
        except ValueError as error:
            remedy = "give the model.json of a results folder"
            raise InputError(str(path), str(error), remedy) from None
        return cls(read.model, signals, name, str(path), read.text, read.poles)

    @classmethod
    def _of_model(cls, model: Model, name: str, source: str) -> Self:
        text = "state space" if isinstance(model, StateSpaceModel) else str(model.orders)
        return cls(model, Signals.of_model(model), name, source, text, model.poles())


def identifier(text: str) -> str:
    """A name in C, of letters, digits and underscores, that begins with a letter.

    It is not that of a header of C's library, which the exported one would hide.
    """
    words = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")
    is_free = words[:1].isalpha() and words.lower() not in _HEADERS
    return words if is_free else f"model_{words}".rstrip("_")


def export_c(model: str | Path | Model, folder: str | Path) -> list[Path]:
    """Write a model, or that of a ``model.json`` in recorded units, as C99 and its header.

    It simulates and predicts one step ahead.  Of other files in the folder none is replaced.

    Returns
    -------
    list of Path
        The two files, named after the folder of the ``model.json``.

    Raises
    ------
    InputError
        When a file is missing, is no model, or is not one of evopem that would be replaced.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import evopem
    >>> with TemporaryDirectory() as folder:
    ...     files = evopem.export_c(evopem.PolynomialModel([1.0, -0.5], [2.0], nk=1), folder)
    ...     [file.name for file in files]
    ['model.c', 'model.h']
    """
    exported, target = Exported.of(model), checked_path("export", folder)
    if os.path.exists(target) and not os.path.isdir(target):  # noqa: PTH110, PTH112 - no error
        raise InputError(str(target), "is no folder", "give that of a folder, or a new one")
    texts = c_texts(exported)
    for name in texts:
        check_own(target / name, "file of evopem", lambda path: has_mark(path, _MARK))
    for name, text in texts.items():
        write_text(target / name, text)
    return [target / name for name in texts]


def c_texts(exported: Exported) -> dict[str, str]:
    """The contents of the file and its header by their names."""
    return rendered(exported, {f"{exported.name}.{kind}": f"model.{kind}.j2" for kind in "ch"})


def rendered(exported: Exported, templates: dict[str, str], **more: Any) -> dict[str, str]:
    """Files of templates about a model, by name."""
    check_packages(("jinja2",), "export", "the exported files")
    context = _context(exported) | more
    try:
        return {
            name: environment(name.endswith(".xml")).get_template(template).render(context)
            for name, template in templates.items()
        }
    except ArithmeticError as error:
        raise InputError(exported.source, str(error), "estimate the model again") from None


def environment(escaped: bool) -> "Environment":
    """The environment of the templates, with filters for numbers and texts in C."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    made = Environment(
        loader=FileSystemLoader(shipped("templates") / "export"),
        autoescape=escaped,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters.update(number=number, array=array, plain=plain, transposed=np.transpose)
    return made


def number(value: float) -> str:
    """A floating-point constant of C that is exactly this number; ArithmeticError of no number."""
    if not math.isfinite(value):
        raise ArithmeticError("a number of the model or its transforms is not finite")
    text = f"{value:.17g}"
    return text if "." in text or "e" in text else f"{text}.0"


def array(values: NDArray[Any] | Sequence[Any]) -> str:
    """The initialiser of an array of any dimension."""
    if np.ndim(values) == 1:
        inner = ", ".join(map(number, values))
        return f"{{{inner}}}" if len(inner) < _WIDTH else _lines(fill(inner, _WIDTH))
    return _lines(",\n".join(map(array, values)))


def _lines(inner: str) -> str:
    return f"{{\n{indent(inner, '    ')}\n}}"


def printed(text: str) -> str:
    """A text with blanks for line breaks and whatever else is not printed."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def plain(text: str) -> str:
    """A text within a comment, which it neither ends nor begins anew."""
    return re.sub(r"\*(?=/)|/(?=\*)", r"\g<0> ", printed(text))


def _context(exported: Exported) -> Context:
    model, signals, upper = exported.model, exported.signals, exported.name.upper()
    inputs, outputs = f"{upper}_INPUTS", f"{upper}_OUTPUTS"
    # The poles of the predictor are the roots of C and of all F_i, or eigenvalues of ``A - K C``.
    f = [roots(f[1:]) for f in model.F] if isinstance(model, PolynomialModel) else []
    parts = _polynomials(model) if isinstance(model, PolynomialModel) else _state_space(model)
    return {
        "version": __version__,
        "name": exported.name,
        "exported": exported,
        "rate": f"{model.sampling_rate:.15g}",
        "interval": 1.0 / model.sampling_rate,
        "m": model.inputs,
        "NU": inputs,
        "NY": outputs,
        "given": f"const double u[{inputs}]",
        "measured": f"const double y[{outputs}]",
        "signals": signals,
        "logarithm": abs(signals.box_cox or 0.0) < _SMALLEST_BOX_COX,
        "preparation": _preparation(signals, model.sampling_rate),
        "simulation_fades": _fading(exported.poles),
        "prediction_fades": _fading(np.concatenate([model.noise_zeros(), *f])),
        "polynomials": isinstance(model, PolynomialModel),
        **parts,
        "first": signals.lost + parts["first"],
    }


def _fading(poles: Complex) -> str:
    """How long what was before the first sample is felt."""
    radius = float(np.abs(poles).max(initial=0.0))
    if radius >= 1.0:
        return "what was before does not fade"
    samples = math.ceil(math.log(_FADED) / math.log(radius)) if radius > 0.0 else 0
    return f"what was before fades to 1 % in about {samples + 1} samples"


def _polynomials(model: PolynomialModel) -> Context:
    """The polynomials; those of all inputs as the rows of one table."""
    delayed = [model.delayed_b(place) for place in range(model.inputs)]
    below = [np.convolve(model.A, f) for f in model.F]
    b, f, noise, paths = map(_table, (delayed, model.F, (model.C, model.D), delayed + below))
    orders = {"a": len(model.A) - 1, "b": b.shape[1] - 1, "f": f.shape[1] - 1}
    return {
        **dict(zip("abcdf", (model.A, b, *noise, f), strict=True)),
        **{f"{letter}_order": order for letter, order in orders.items()},
        "noise_order": noise.shape[1] - 1,
        "ones": 1 + max(orders.values()) if any(orders.values()) else 0,
        "path_order": max(paths.shape[1] - 1, 1),
        "numerators": paths[: model.inputs],
        "denominators": paths[model.inputs :],
        "level": model.level,
        "simulated_level": model.output_level,
        "first": model.orders.first_residual,
    }


def _table(rows: Sequence[Array]) -> Array:
    """Rows in one array, the shorter ones with zeros at their ends."""
    width = max(map(len, rows), default=1)
    return np.reshape([np.pad(row, (0, width - len(row))) for row in rows], (len(rows), width))


def _state_space(model: StateSpaceModel) -> Context:
    """The matrices and delays."""
    names = "A", "B", "C", "D", "K", "level"
    delays = model.delays
    return {
        **{name: getattr(model, name) for name in names},
        "noise": bool(np.any(model.K)),
        "states": model.order,
        "delays": delays,
        "longest_delay": max(delays, default=0),
        "first": 0,
    }


def _preparation(signals: Signals, rate: float) -> list[str]:
    """What is done to the recorded signals, and what is left to who gives them."""
    said = []
    if signals.resampled_from is not None:
        said.append(
            f"Not here: the recording, at {signals.resampled_from:.15g} Hz, was filtered against"
            f" aliasing and brought to {rate:.15g} Hz. Give samples at {rate:.15g} Hz that are"
            " filtered likewise."
        )
    if signals.has_trend:
        said.append(
            "Straight lines are taken from the channels. They begin with the recording; the first"
            f" sample here is at {signals.start:.15g} s of it (start)."
        )
    if signals.box_cox is not None:
        said.append(
            f"The output plus {signals.shift:.6g} goes through the Box-Cox transform of parameter"
            f" {signals.box_cox:.6g}. A measured one that is not positive then is NAN, and so is"
            " what follows."
        )
    if signals.lost:
        filtered = f" over (1 - {signals.difference_pole:g} q^-1)" * (signals.difference_pole > 0.0)
        said.append(
            f"The outputs are differenced {signals.difference} times, the inputs"
            f" {signals.difference_input} times{filtered}. A simulation adds up, from the recorded"
            " values before the estimation samples on."
        )
    levels = "are those of the estimation samples" if signals.recordings else "are 0"
    levels += f" of the first of {signals.recordings} recordings" * (signals.recordings > 1)
    levels += "; those of other recordings differ" * signals.own_levels
    return [*said, f"Levels (input_level, output_level) {levels}."]
