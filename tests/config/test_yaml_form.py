"""The settings of a data set as YAML keys: what is not set, and files of another form."""

import pytest

from evopem.config.defaults import complete, read_settings
from evopem.errors import InputError


def test_what_is_not_set_is_left_out():
    written = {"a": {"file": "x.csv", "recipe": "chapter"}}
    keys = complete({"datasets": written}).datasets["a"].keys
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
