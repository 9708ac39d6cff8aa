"""The settings of a data set as YAML keys: what is written is what is read."""

import pytest
import yaml
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from evopem.config.channels import (
    ChannelSettings,
    RecordedSource,
    SyntheticSource,
    UnitSettings,
    is_pattern,
)
from evopem.config.checks import check_several_recordings
from evopem.config.constraints import Constraints, FixedPole, Prior
from evopem.config.defaults import complete
from evopem.config.settings import (
    DatasetSettings,
    DelaySettings,
    FitSettings,
    OrderGrid,
    OrderSettings,
    PreparationSettings,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    TransformSettings,
)
from evopem.config.source_checks import Place
from evopem.config.yaml_form import keys_of, read_settings, yaml_text
from evopem.errors import InputError


def ranges(low, high):
    return st.tuples(st.integers(low, high), st.integers(low, high)).map(sorted).map(tuple)


rates = st.floats(1e-3, 1e6)
words = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=12)
# A name with an asterisk stands for several channels, which other settings have.
names = words.filter(lambda name: not is_pattern(name))
channels = st.builds(
    ChannelSettings,
    inputs=st.tuples(st.integers(1, 99) | names),
    outputs=st.tuples(st.integers(100, 199)),
    sampling_rate=st.none() | rates,
    time=st.none(),
    input_units=st.builds(UnitSettings, words),
    output_units=st.just(UnitSettings()),
) | st.builds(ChannelSettings, inputs=st.just((2,)), outputs=st.just((3,)), time=st.just("t"))
files = words.filter(lambda name: not set("{}*") & set(name))
sources = (
    st.builds(
        RecordedSource,
        st.tuples(files) | st.just(("run 1.csv", "run ü.csv")),
        channels,
        st.just(()) | st.just(("independent.csv",)),
    )
    | st.builds(
        SyntheticSource,
        st.just("armax"),
        seed=st.integers(0, 2**63),
        samples=st.integers(200, 10**6),
        sampling_rate=rates,
        noise=st.floats(0, 9),
    )
    | st.builds(SyntheticSource, st.just("flexible_arm"), sampling_rate=rates)
)
bands = st.tuples(st.floats(0, 10), st.floats(10, 100))
fits = st.builds(
    FitSettings,
    focus=st.sampled_from(["prediction", "simulation"]) | st.integers(1, 1000),
    constraints=st.none()
    | st.builds(
        Constraints,
        max_pole_radius=st.floats(0.5, 2),
        forbidden_bands=st.lists(bands, max_size=2).map(tuple),
        static_gain_bounds=st.none() | st.tuples(st.none(), st.floats(-9, 9)),
        fixed_coefficients=st.dictionaries(st.sampled_from(["a1", "b0"]), st.floats(-9, 9)),
        fixed_poles=st.lists(st.builds(FixedPole, st.floats(-1, 1)), max_size=2).map(tuple),
        priors=st.lists(
            st.builds(Prior, words, st.floats(-9, 9), st.floats(0.1, 9)), max_size=2
        ).map(tuple),
    ),
)
datasets = st.builds(
    DatasetSettings,
    name=st.from_regex(r"[a-z0-9][a-z0-9_-]{0,12}", fullmatch=True),
    source=sources.filter(lambda each: getattr(each, "file", "") != "independent.csv"),
    preparation=st.builds(
        PreparationSettings,
        transforms=st.builds(
            TransformSettings,
            box_cox=st.sampled_from(["auto", "none"]) | st.floats(-5, 5),
            difference=st.integers(0, 4),
            difference_input=st.integers(0, 4),
        ),
        split=st.builds(
            SplitSettings,
            discard=st.integers(0, 10**4) | st.floats(0.01, 0.9),
            estimation=st.integers(1, 10**4) | st.floats(0.1, 0.9),
        ),
        resample=st.none() | rates,
    ),
    spectrum=st.builds(SpectrumSettings, st.floats(1.5, 20), st.integers(16, 2**20)),
    order_grid=st.builds(
        OrderGrid,
        delay=st.builds(DelaySettings, ranges(1, 60), ranges(0, 1000)),
        orders=st.builds(
            OrderSettings, ranges(1, 60) | st.just("auto"), ranges(1, 60), ranges(1, 60)
        ),
    ),
    search=st.builds(
        SearchSettings,
        objective=st.sampled_from(["absolute", "quadratic"]),
        initialization=st.sampled_from(["arx", "incremental_order"]),
        mu=st.integers(1, 20),
        lambda_=st.integers(20, 200),
        nu=st.integers(1, 20),
        refine=st.sampled_from(["worst", "all", "best", "random"]),
        seed=st.integers(0, 2**63),
        evaluations=st.integers(1, 10**9),
        max_root_radius=st.floats(0.5, 0.99999),
        n_initial_discard=st.integers(0, 1000),
    ),
    fit=fits,
)


def accepted(settings):
    """Whether a data set of several recordings has no key that it cannot have."""
    try:
        check_several_recordings(settings, Place("", ""))
    except InputError:
        return False
    return True


datasets = datasets.filter(accepted)


@examples(max_examples=60, deadline=None)
@given(datasets)
def test_the_written_configuration_is_one_that_a_user_may_write(settings):
    """It passes the schema and all checks, and completes to the same settings."""
    written = yaml.safe_load(yaml_text(settings))
    assert complete(written).datasets == {settings.name: settings}


@examples(max_examples=30, deadline=None)
@given(datasets)
def test_a_written_configuration_is_read_again(tmp_path_factory, settings):
    path = tmp_path_factory.mktemp("configuration") / "config.yaml"
    path.write_text(yaml_text(settings), encoding="utf-8")
    assert read_settings(path) == settings


def test_what_is_not_set_is_left_out():
    written = {"a": {"file": "x.csv", "recipe": "chapter"}}
    keys = keys_of(complete({"datasets": written}).datasets["a"])
    assert list(keys)[:3] == ["file", "uneven_time", "recipe"]
    assert not {"input", "output", "sampling_rate", "time", "validation_file"} & set(keys)
    assert keys["resample"] == "none"
    assert keys["delay"] == {"orders": [6, 9], "nk": [0, 3]}


@pytest.mark.parametrize(
    "content",
    [
        None,
        b"",
        b"[]",
        b"datasets: {}",
        b"datasets: {a: {file: x.csv}}",
        b"datasets: {a: {synthesis: armax}, b: {synthesis: armax}}",
        b"datasets: {a: [",
        b"\xff",
    ],
)
def test_another_file_is_refused_in_a_sentence(tmp_path, content):
    path = tmp_path / "config.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match="complete configuration of one data set") as caught:
        read_settings(path)
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)
