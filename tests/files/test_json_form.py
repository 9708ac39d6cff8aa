"""The JSON form of typed results and settings: what is written is what is read."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from evopem.automatic.decision import DecisionRecord, OtherModel, Trial
from evopem.automatic.orders import DelayChoice
from evopem.config import settings
from evopem.config.channels import ChannelSettings, SyntheticSource
from evopem.config.settings import OrderRanges, SearchSettings
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_candidate import Candidate, PhaseSelection
from evopem.files.job import UnfinishedJob
from evopem.files.json_form import from_json, load, load_shared, save, to_json
from evopem.models.mode_matching import OrderModels
from evopem.models.orders import Orders, armax_orders
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.state_space import StateSpaceModel
from evopem.results.fleet import DatasetSummary
from evopem.results.identity import MadeFrom
from evopem.signals.peaks import SpectrumSummary
from evopem.signals.prepared_data import Transforms
from evopem.signals.recording_info import RecordingInfo
from evopem.synthesis import Truth
from evopem.validation.validation import Validation

SCRIPTS = Path(__file__).parents[2] / "workflow" / "scripts"
RESULTS = [
    Candidate,
    DatasetSummary,
    DecisionRecord,
    DelayChoice,
    MadeFrom,
    ModelRecord,
    RecordingInfo,
    OrderModels,
    OtherModel,
    Orders,
    PhaseSelection,
    PolynomialModel,
    SpectrumSummary,
    Transforms,
    Truth,
    UnfinishedJob,
    Validation,
]
SETTINGS = sorted(
    {kind for kind in vars(settings).values() if isinstance(kind, type) and is_dataclass(kind)},
    key=lambda kind: kind.__name__,
)

FINITE = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def state_space_models(draw: st.DrawFn) -> StateSpaceModel:
    """A model whose matrices fit together, with inputs or without."""
    n, nu, ny = draw(st.integers(1, 3)), draw(st.integers(0, 2)), draw(st.integers(1, 3))
    shapes = {"A": (n, n), "B": (n, nu), "C": (ny, n), "D": (ny, nu), "K": (n, ny)}
    shapes |= {"level": (ny,), "noise_covariance": (ny, ny)}
    matrices = {name: draw(arrays.arrays(float, shape)) for name, shape in shapes.items()}
    return StateSpaceModel(**matrices, sampling_rate=draw(FINITE))


@st.composite
def polynomial_models(draw: Any) -> PolynomialModel:
    """Any numbers in polynomials of up to two inputs."""

    def polynomial() -> Any:
        return arrays.arrays(float, st.integers(1, 4), elements=FINITE)

    inputs = draw(st.integers(0, 2))
    B, F = ([draw(polynomial()) for _ in range(inputs)] for _ in range(2))
    return PolynomialModel(
        *(draw(polynomial()), B, draw(polynomial()), draw(polynomial()), F or [1.0]),
        nk=draw(st.lists(st.integers(0, 9), min_size=inputs, max_size=inputs)),
        sampling_rate=draw(FINITE),
        covariance=draw(instances(ParameterCovariance | None)),
        input_names=draw(st.lists(st.text(), max_size=2)),
        output_names=draw(st.lists(st.text(), max_size=1)),
    )


def instances(kind: Any) -> st.SearchStrategy[Any]:
    """Any value of a type, as its annotation states it; floats may be infinite or NaN."""
    if kind is Orders:
        high = st.integers(0, 60)
        return st.builds(Orders, na=high, nb=st.integers(1, 60), nc=high, nk=high)
    if kind is PolynomialModel:
        return polynomial_models()
    if kind is StateSpaceModel:
        return state_space_models()
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return st.builds(kind, **{each.name: instances(hints[each.name]) for each in fields(kind)})
    if kind is Any:  # keys of a configuration as they were written
        return st.none() | st.booleans() | st.integers() | st.text() | st.lists(st.text())
    if kind is complex:
        return st.complex_numbers(allow_nan=False, allow_infinity=False)
    if kind in (int, str, bool, float):
        return st.from_type(kind)
    origin, members = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        # In a union JSON itself tells the members apart, and NaN has no form of its own there.
        return st.one_of([FINITE if each is float else instances(each) for each in members])
    if origin is Literal:
        return st.sampled_from(members)
    if origin in (dict, Mapping):
        return st.dictionaries(*map(instances, members), max_size=3)
    if origin is tuple and members[-1] is Ellipsis:
        return st.lists(instances(members[0]), max_size=3).map(tuple)
    if origin is tuple:
        return st.tuples(*map(instances, members))
    if origin is np.ndarray:
        shape = arrays.array_shapes(min_dims=1, max_dims=2, max_side=3)
        if "complex" in str(kind):
            finite = st.complex_numbers(allow_nan=False, allow_infinity=False)
            return arrays.arrays(complex, st.integers(0, 3), elements=finite)
        return arrays.arrays(float, st.integers(0, 3) | shape)
    return st.none() if kind is type(None) else st.from_type(kind)


def expected(value: Any) -> Any:
    """A value as it is read back: with NaN for what is not finite."""
    if isinstance(value, np.ndarray):
        return np.where(np.isfinite(value), value, np.nan)
    return math.nan if isinstance(value, float) and not math.isfinite(value) else value


def assert_same(read: Any, written: Any) -> None:
    """Types, values and signs of zero are the same, to the last bit."""
    written = expected(written)
    assert type(read) is type(written)
    if is_dataclass(read):
        for field in fields(read):
            assert_same(getattr(read, field.name), getattr(written, field.name))
    elif isinstance(read, tuple):
        assert len(read) == len(written)
        for one, other in zip(read, written, strict=True):
            assert_same(one, other)
    elif isinstance(read, dict):
        assert list(read) == list(written)
        for key in read:
            assert_same(read[key], written[key])
    elif isinstance(read, np.ndarray):
        assert read.dtype == written.dtype
        np.testing.assert_array_equal(read, written)
    else:
        assert repr(read) == repr(written)


@pytest.mark.parametrize(
    "kind",
    [*RESULTS, *sorted(SETTINGS, key=lambda kind: kind.__name__)],
    ids=lambda kind: kind.__name__,
)
@examples(max_examples=15, deadline=None)
@given(data=st.data())
def test_what_is_written_is_what_is_read(kind, data):
    value = data.draw(instances(kind))
    text = json.dumps(to_json(value), allow_nan=False)
    assert_same(from_json(kind, json.loads(text)), value)


def test_every_type_that_a_stage_reads_is_among_them():
    """A new result has to be added to the types above.

    Decisions of the automatic recipe are written and read between its stages, in
    tests/pipeline/test_automatic.py.
    """
    decisions = {"DecisionRecord", "PreparationPlan", "Comparison"}
    decisions |= {"Revised", "StructureSearch", "FoldPlan", "Varying"}
    listed = {kind.__name__ for kind in [*RESULTS, *SETTINGS]} | decisions
    read = set()
    for file in SCRIPTS.rglob("*.py"):
        pattern = r"(?<![.\w])(?:load|from_json)\((?:tuple\[)?([A-Z]\w+)"
        read |= set(re.findall(pattern, file.read_text(encoding="utf-8")))
    assert len(read) > 8
    assert read <= listed


@dataclass(frozen=True, eq=False)
class Example:
    number: float
    maybe: float | None
    array: np.ndarray[Any, np.dtype[np.float64]]
    lambda_: int = 3


def test_truth_values_of_numpy_are_those_of_json():
    assert json.dumps(to_json(Trial("a", "b", "c", 1.0, 0.5, 0.5, np.False_))).endswith("false}")


def test_numbers_that_are_not_finite_become_null():
    content = to_json(Example(math.inf, math.nan, np.array([1.0, -math.inf])))
    assert content == {"number": None, "maybe": None, "array": [1.0, None], "lambda": 3}
    again = from_json(Example, content)
    assert math.isnan(again.number)
    assert again.maybe is None
    np.testing.assert_array_equal(again.array, [1.0, np.nan])


def test_an_underscore_that_avoids_a_keyword_is_no_part_of_the_key():
    assert to_json(SearchSettings())["lambda"] == 100
    assert from_json(SearchSettings, {"lambda": 7}).lambda_ == 7
    with pytest.raises(InputError, match="the key lambda_ is not known"):
        from_json(SearchSettings, {"lambda_": 7})


ORDERS = {"na": 2, "nb": [1], "nc": 1, "nf": [0], "nk": [0]}


@pytest.mark.parametrize(
    ("kind", "content", "place", "problem"),
    [
        (Orders, ORDERS | {"na": 2.7}, "na", "2.7 is not a whole number"),
        (Orders, ORDERS | {"na": "2"}, "na", "'2' is not a whole number"),
        (Orders, ORDERS | {"na": True}, "na", "True is not a whole number"),
        (Orders, ORDERS | {"na": None}, "na", "None is not a whole number"),
        (Orders, ORDERS | {"nb": [], "nf": [1]}, "", "without an input, nb = 0"),
        (Orders, ORDERS | {"ne": 1}, "", "the key ne is not known"),
        (Orders, [1, 1, 1, 0], "", "the content has another form"),
        (Orders, None, "", "the content has another form"),
        (SearchSettings, {"objective": "cubic"}, "objective", "'cubic' is none of absolute, qu"),
        (SearchSettings, {"max_root_radius": "0.9"}, "max_root_radius", "'0.9' is not a number"),
        (SyntheticSource, {"synthesis": "pendulum"}, "synthesis", "'pendulum' is none of flex"),
        (ChannelSettings, {"inputs": [[1]]}, "inputs[0]", "[1] cannot be used here"),
        (ChannelSettings, {"outputs": None}, "outputs", "None is not a list"),
        (OrderRanges, {"nc": [1, 2, 3]}, "nc", "[1, 2, 3] has not 2 entries"),
        (OrderRanges, {"nc": "ab"}, "nc", "'ab' is not a list"),
        (OrderRanges, {"nb": "aut"}, "nb", "'aut' cannot be used here"),
        (
            tuple[Orders, ...],
            [ORDERS, ORDERS | {"nk": [0.5]}],
            "[1].nk[0]",
            "0.5 is not a whole",
        ),
        (tuple[Orders, ...], {}, "", "{} is not a list"),
    ],
)
def test_other_content_is_refused_in_a_sentence_that_names_the_field(kind, content, place, problem):
    with pytest.raises(InputError) as caught:
        from_json(kind, content, "file.json")
    error = caught.value
    assert (error.source, error.place) == ("file.json", place)
    assert problem in error.problem
    assert re.fullmatch(r"file\.json(, [^:]+)?: .+; delete the file and .+\.", str(error))


def test_a_field_deep_inside_is_named():
    content = to_json(settings.OrderGrid())
    content["ranges"]["nc"] = [2, "x"]
    with pytest.raises(
        InputError, match=r"^file\.json, ranges\.nc\[1\]: 'x' is not a whole number; "
    ):
        from_json(settings.OrderGrid, content, "file.json")


@pytest.mark.parametrize(("indent", "lines"), [(2, 32), (None, 1)])
def test_a_file_holds_what_was_saved(tmp_path, indent, lines):
    path = tmp_path / "orders.json"
    save((armax_orders(1, 2, 3, 4), armax_orders(4, 3, 2, 1)), path, indent)
    assert path.read_text(encoding="utf-8").count("\n") == lines
    assert load(tuple[Orders, ...], path) == (
        armax_orders(1, 2, 3, 4),
        armax_orders(4, 3, 2, 1),
    )


@pytest.mark.parametrize(
    ("content", "problem"),
    [(None, "cannot be read (No such file"), (b"{", "is not valid JSON"), (b"\xff", "not valid")],
)
def test_files_that_hold_no_json_are_refused_in_a_sentence(tmp_path, content, problem):
    path = tmp_path / "orders.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load(Orders, path)
    assert caught.value.source == str(path)
    assert problem in caught.value.problem


def test_what_is_not_json_is_refused_and_leaves_no_file(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        save(complex(math.nan, 0.0), tmp_path / "x.json")
    assert list(tmp_path.iterdir()) == []


def test_a_shared_file_is_read_once_while_it_stays_the_same(tmp_path):
    save(OrderRanges(nx=(1, 2)), path := tmp_path / "ranges.json")
    first = load_shared(OrderRanges, path)
    assert load_shared(OrderRanges, path) is first
    save(OrderRanges(nx=(1, 20)), path)
    assert load_shared(OrderRanges, path) == OrderRanges(nx=(1, 20))
    path.unlink()
    with pytest.raises(InputError, match="cannot be read"):
        load_shared(OrderRanges, path)
