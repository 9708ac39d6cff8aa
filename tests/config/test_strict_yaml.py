"""YAML that a reader would misunderstand: refused in one sentence with its line, and quickly."""

import os
import re
import time

import pytest

from evopem.config.strict_yaml import check_yaml_files, read_value
from evopem.errors import InputError

LAUGHS = "a0: &a0 {x: 1, y: 2, z: 3}\n" + "".join(
    f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]\n" for level in range(1, 10)
)
MERGED = "a0: &a0 {x: 1}\n" + "".join(
    f"a{level}: &a{level} {{p: *a{level - 1}, q: *a{level - 1}, r: *a{level - 1}}}\n"
    for level in range(1, 16)
)

REFUSED = {
    "octal": ("s: 1\nrate: 0100\n", "line 2", "0100 as 64", "quotes"),
    "negative octal": ("rate: -010\n", "line 1", "-010 as -8", "quotes"),
    "zero before 8": ("rate: 08\n", "line 1", "08 as text", "quotes"),
    "zeros": ("rate: 000\n", "line 1", "000 as 0", "quotes"),
    "hexadecimal": ("rate: 0x10\n", "line 1", "0x10 as 16", "decimal digits"),
    "binary": ("rate: 0b11\n", "line 1", "0b11 as 3", "decimal digits"),
    "underscore": ("rate: 1_000\n", "line 1", "1_000 as 1000", "decimal digits"),
    "underscored fraction": ("rate: 1_0.5\n", "line 1", "1_0.5 as 10.5", "decimal digits"),
    "sexagesimal": ("time: 1:30\n", "line 1", "1:30 as 90", "quotes"),
    "sexagesimal fraction": ("time: 1:30.5\n", "line 1", "1:30.5 as 90.5", "quotes"),
    "yes": ("input: yes\n", "line 1", "yes as true", "quotes"),
    "On": ("input: [1, On]\n", "line 1", "On as true", "quotes"),
    "off": ("a:\n  input: off\n", "line 2", "off as false", "quotes"),
    "no": ("report: no\n", "line 1", "no as false", "quotes"),
    "True": ("report: True\n", "line 1", "True as true", "quotes"),
    "date": ("input: 2024-01-31\n", "line 1", "2024-01-31 as a date", "quotes"),
    "impossible date": ("a: 1\ninput: 2024-13-45\n", "line 2", "2024-13-45 as a date", "quotes"),
    "time stamp": ("input: 2024-01-31T10:00:00Z\n", "line 1", "as a date", "quotes"),
    "alias to itself": ("d: &a {b: *a}\n", "line 1", "leads back", "remove it"),
    "list in itself": ("d: &a [1, *a]\n", "line 1", "leads back", "remove it"),
    "alias of nothing": ("d: *a\n", "line 1", "undefined alias", "check"),
    "int tag": ("a: !!int x\n", "line 1", "the tag !!int has no meaning", "without a tag"),
    "int tag on text": ('a: !!int "3"\n', "line 1", "the tag !!int", "without a tag"),
    "float tag": ("a: !!float x\n", "line 1", "the tag !!float", "without a tag"),
    "bool tag": ("a: !!bool x\n", "line 1", "the tag !!bool", "without a tag"),
    "time tag": ("a: !!timestamp x\n", "line 1", "the tag !!timestamp", "without a tag"),
    "null tag": ("a: !!null x\n", "line 1", "the tag !!null", "without a tag"),
    "binary tag": ("a: !!binary aGVsbG8=\n", "line 1", "the tag !!binary", "without a tag"),
    "set": ("a: !!set {x}\n", "line 1", "the tag !!set", "without a tag"),
    "ordered map": ("a: !!omap [x: 1]\n", "line 1", "the tag !!omap", "without a tag"),
    "python object": ("a: !!python/object/apply:os.getcwd []\n", "line 1", "the tag", "tag"),
    "own tag": ("a: !mine 3\n", "line 1", "the tag !mine", "without a tag"),
    "equals sign": ("a: =\n", "line 1", "the tag !!value", "quotes"),
    "merge sign as a value": ("a: <<\n", "line 1", "the tag !!merge", "quotes"),
    "merged text": ("a: {<<: x}\n", "line 1", "only a mapping can be merged", "alias"),
    "merged list": ("a: {<<: [1]}\n", "line 1", "only a mapping can be merged", "alias"),
    "list as a key": ("? [1, 2]\n: 3\n", "line 1", "is read as a list", "quotes"),
    "mapping as a key": ("? {a: 1}\n: 3\n", "line 1", "is read as a mapping", "quotes"),
    "date as a key": ("2024-13-45: 1\n", "line 1", "is read as a date", "quotes"),
    "number as a key": ("007: 1\n", "line 1", "is read as 7", "quotes"),
    "null as a key": ("~: 1\n", "line 1", "is read as no value", "quotes"),
    "repeated key": ("a: 1\n'a': 2\n", "line 2", "second time", "keep one"),
    "surrogate": ('a: "\\ud800"\n', "line 1", "U+D800 is no text", "remove it"),
    "null character": ('a: "x\\0"\n', "line 1", "U+0000 is no text", "remove it"),
    "escape sequence": ('a: "\\e[31m"\n', "line 1", "U+001B is no text", "remove it"),
    "beyond Unicode": ('a: "\\UFFFFFFFF"\n', "", "is no character", "correct it"),
    "null byte": ("a: \0\n", "", "this is not YAML", "check"),
    "5000 digits": ("a: " + "7" * 5000 + "\n", "line 1", "a number of 5000 digits", "quotes"),
    "many zeros": ("a: 1" + "0" * 400 + "\n", "line 1", "... as a number of 401 digits", "quotes"),
    "many brackets": ("a: " + "[" * 3000 + "\n", "", "nested too deeply", "brackets"),
    "closed brackets": ("a: " + "[" * 3000 + "]" * 3000, "", "nested too deeply", "brackets"),
    "30 levels": ("a: " + "[" * 30 + "]" * 30, "line 1", "more than 20 levels", "brackets"),
    "deep indentation": (
        "".join(f"{' ' * level}k:\n" for level in range(40)),
        "line",
        "more than 20 levels",
        "brackets",
    ),
    "aliases of aliases": (LAUGHS, "line", "once its aliases are written out", "fewer"),
    "mappings of aliases": (MERGED, "line", "once its aliases are written out", "fewer"),
    "tab": ("a:\n\tb: 1\n", "line 2", "this is not YAML", "tabs"),
    "two documents": ("a: 1\n---\nb: 2\n", "line 2", "this is not YAML", "check"),
    "UTF-16": ("a: 1\n".encode("utf-16"), "", "is not UTF-8", "UTF-8"),
    "Latin-1": ("a: ä\n".encode("latin-1"), "", "is not UTF-8", "UTF-8"),
    "a list": ("- a\n", "", "no keys in it", "datasets"),
    "empty": ("", "", "no keys in it", "datasets"),
    "comments": ("# nothing\n", "", "no keys in it", "datasets"),
    "empty mapping": ("{}\n", "", "no keys in it", "datasets"),
    "a word": ("datasets\n", "", "no keys in it", "datasets"),
}


def refusal(path):
    with pytest.raises(InputError) as caught:
        check_yaml_files([path])
    sentence = str(caught.value)
    assert re.fullmatch(r".+config\.yaml[^:]*: .+; .+\.", sentence)
    assert len(sentence) < 400 + len(str(path))
    return sentence


@pytest.mark.parametrize("name", REFUSED)
def test_what_would_be_misread_is_refused_with_its_line(tmp_path, name):
    content, line, problem, remedy = REFUSED[name]
    path = tmp_path / "config.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    before = time.process_time()
    sentence = refusal(path)
    assert time.process_time() - before < 2
    assert f"{line}:" in sentence or line in sentence
    assert problem in sentence
    assert remedy in sentence


@pytest.mark.parametrize(
    "text",
    [
        "a: {n: 100, m: -3, x: 1.5, y: .5, z: 2., w: 1.0e+3, v: -0, u: 0, t: 0.5}\n",
        "a: ['0100', \"yes\", '2024-01-31', '1:30', no thanks, run_007, 1.2.3, 12 N m]\n",
        "base: &b {x: 1}\na: {<<: *b, y: 2}\nc: {<<: [*b, *b], x: 3}\nd: [*b, *b]\n",
        "a: !!str 0100\n",
        "a: |\n  two\n  lines\nb: ~\nc:\n",
        "\ufeffa: Größe\n",
        "a: 1\r\nb: 2\r\n",
        '{"datasets": {"a": {"file": "x.csv", "sampling_rate": 100.0}}}',
    ],
)
def test_usual_yaml_passes(tmp_path, text):
    path = tmp_path / "config.yaml"
    path.write_bytes(text.encode())
    check_yaml_files([path, tmp_path / "missing.yaml"])


def test_what_is_no_regular_file_is_refused_without_being_opened(tmp_path):
    path = tmp_path / "config.yaml"
    os.mkfifo(path)
    assert "is not a regular file" in refusal(path)
    path.unlink()
    path.mkdir()
    assert "is not a regular file" in refusal(path)


def test_three_thousand_entries_pass_in_seconds(tmp_path):
    path = tmp_path / "config.yaml"
    entries = (f"  r{n}: {{file: data/{n}.csv, sampling_rate: 100}}\n" for n in range(3_000))
    path.write_text("datasets:\n" + "".join(entries))
    before = time.process_time()
    check_yaml_files([path])
    assert time.process_time() - before < 3


@pytest.mark.parametrize("cell", ["[9, 2024-13-45]", "[" * 3000, "[010, 12]", "[!!int x]", "[1, 2"])
def test_a_cell_is_held_to_the_same_rules(cell):
    with pytest.raises(InputError, match=r"^t\.csv, line 7, column orders\.nc: "):
        read_value(cell, "t.csv", "line 7, column orders.nc")


def test_a_cell_is_read():
    assert read_value("[6, 12]", "t.csv", "line 2") == [6, 12]
