"""Tables of data sets as spreadsheets and other programs write them, and hostile ones."""

import io
import re
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evopem.config.defaults import complete
from evopem.errors import InputError

SCHEMA = Path(__file__).parents[2] / "workflow" / "schemas" / "config.schema.yaml"

ROWS = "name,file,sampling_rate,split.estimation,orders.nc\na,1.csv,100,0.8,{list}\nb,2.csv,,,\n"
PLAIN = ROWS.format(list='"[6, 9]"')


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def completed(content, name="recordings.csv"):
    Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return complete({"datasets": name}).datasets


def separated(separator, text=PLAIN):
    cells = pd.read_csv(io.StringIO(text), dtype=str)
    return cells.to_csv(sep=separator, index=False)


def with_decimal_commas():
    """As a spreadsheet set to German, French or Danish saves it."""
    return (
        "name;file;sampling_rate;split.estimation;orders.nc\na;1.csv;100,0;0,8;[6, 9]\nb;2.csv;;;\n"
    )


def frame():
    return pd.DataFrame(
        {
            "name": ["a", "b"],
            "file": ["1.csv", "2.csv"],
            "sampling_rate": [100.0, np.nan],
            "split.estimation": [0.8, np.nan],
            "orders.nc": ["[6, 9]", None],
        }
    )


def of_excel(encoding, lines="\r\n"):
    return PLAIN.replace("\n", lines).encode(encoding)


SAME = {
    "plain": PLAIN,
    "Excel, CSV UTF-8": of_excel("utf-8-sig"),
    "Excel, Unicode text": separated("\t").replace("\n", "\r\n").encode("utf-16"),
    "UTF-16 big endian": b"\xfe\xff" + of_excel("utf-16-be"),
    "UTF-16 with commas": of_excel("utf-16"),
    "CRLF": of_excel("ascii"),
    "CR alone": of_excel("ascii", "\r"),
    "CR with a byte order mark": of_excel("utf-8-sig", "\r"),
    "no line break at the end": PLAIN.rstrip("\n"),
    "semicolons": separated(";"),
    "tabs": separated("\t"),
    "semicolons and decimal commas": with_decimal_commas(),
    "semicolons, decimal commas, CRLF, byte order mark": (
        with_decimal_commas().replace("\n", "\r\n").encode("utf-8-sig")
    ),
    "sep=;": "sep=;\r\n" + separated(";").replace("\n", "\r\n"),
    "sep=; with a byte order mark": ("sep=;\n" + with_decimal_commas()).encode("utf-8-sig"),
    "sep=,": "sep=,\n" + PLAIN,
    "SEP=tab": "SEP=\t\n" + separated("\t"),
    '"sep=;"': '"sep=;"\n' + separated(";"),
    "sep=; and empty columns": "sep=;;;;;\n" + separated(";"),
    "pandas": frame().to_csv(index=False),
    "pandas with its index": frame().to_csv(),
    "pandas with an index from 1": frame().set_index(pd.Index([1, 2])).to_csv(),
    "pandas, everything quoted": frame().to_csv(index=False, quoting=1),
    "pandas, semicolons and decimal commas": frame().to_csv(index=False, sep=";", decimal=","),
    "pandas, CRLF": frame().to_csv(index=False, lineterminator="\r\n"),
    "pandas, numbers in exponents": frame().to_csv(index=False, float_format="%.6e"),
    "pandas, UTF-16": frame().to_csv(index=False).encode("utf-16"),
    "R, write.csv without NA": (
        '"","name","file","sampling_rate","split.estimation","orders.nc"\n'
        '"1","a","1.csv",100,0.8,"[6, 9]"\n"2","b","2.csv",,,\n'
    ),
    "R, write.csv2 without NA": (
        '"";"name";"file";"sampling_rate";"split.estimation";"orders.nc"\n'
        '"1";"a";"1.csv";100;0,8;"[6, 9]"\n"2";"b";"2.csv";;;\n'
    ),
    "MATLAB, writetable": (
        'name,file,sampling_rate,split.estimation,orders.nc\na,1.csv,100,0.8,"[6, 9]"\nb,2.csv,,,'
    ),
    "quoted numbers": PLAIN.replace("100,0.8", '"100","0.8"'),
    "spaces around": "\n".join(" , ".join(line.split(",")) for line in separated(",").splitlines())
    .replace('"[6 ,  9]"', '"[6, 9]"')
    .replace(' "[', '"['),
    "empty rows at the end": PLAIN + ",,,,\n,,,,\n\n",
    "empty rows between": PLAIN.replace("\nb", "\n,,,,\n\nb"),
    "empty columns at the end": "".join(f"{line},,\n" for line in PLAIN.splitlines()),
    "empty column between": "\n".join(
        re.sub("^(.),", r"\1,,", line.replace("name,", "name,,")) for line in PLAIN.splitlines()
    ),
    "longer rows with nothing in them": PLAIN.replace('9]"\n', '9]",,,\n'),
    "row numbers": "\n".join(
        f"{number},{line}" for number, line in zip(["", "1", "2"], PLAIN.splitlines(), strict=True)
    ),
    "numbers with a plus and an exponent": PLAIN.replace("100,0.8", "+1E+02,8E-1"),
    "lower and upper of a list without a space": ROWS.format(list='"[6,9]"'),
    "list with decimal zeros": ROWS.format(list='"[6.0, 9.0]"'),
    "zeros before a number": PLAIN.replace("100,0.8", "0100,00.8"),
    "no-break spaces": PLAIN.replace("100,0.8", "\u00a0100\u00a0,0.8"),
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_table_of_another_program_holds_the_same_data_sets(case):
    expected = complete(
        {
            "datasets": {
                "a": {
                    "file": "1.csv",
                    "sampling_rate": 100,
                    "split": {"estimation": 0.8},
                    "orders": {"nc": [6, 9]},
                },
                "b": {"file": "2.csv"},
            }
        },
        SCHEMA,
    ).datasets
    found = completed(SAME[case])
    assert {name: each.keys for name, each in found.items()} == {
        name: each.keys for name, each in expected.items()
    }


HEADER = "name,file,sampling_rate\n"
REFUSED = {
    "R, write.table: row names without a column": (
        '"name" "file"\n"1" "a" "1.csv"\n'.replace(" ", ","), "line 2", "3 fields and the header 2"
    ),
    "R, NA": (HEADER + "a,1.csv,NA\n", "column sampling_rate", "NA cannot be used"),
    "R, row names that are words": (
        '"","name","file"\n"first","a","1.csv"\n', "line 1", "column 1 has no name"
    ),
    "pandas, an index of times": (
        ",name,file\n2024-01-01,a,1.csv\n", "line 1", "column 1 has no name"
    ),
    "row numbers that skip one": (
        ",name,file\n1,a,1.csv\n3,b,2.csv\n", "line 1", "column 1 has no name"
    ),
    "pandas, an index saved twice": (
        "Unnamed: 0,name,file\n0,a,1.csv\n", "column Unnamed: 0", "there is no such key"
    ),
    "Excel, thousands": (HEADER + 'a,1.csv,"1,000"\n', "sampling_rate", "1,000 cannot be used"),
    "Excel, thousands and decimal comma": (
        "name;file;sampling_rate\na;1.csv;1.234,5\n", "sampling_rate", "1.234,5 cannot be used"
    ),
    "Excel, a point among decimal commas": (
        "name;file;sampling_rate;resample\na;1.csv;12.345;0,5\n",
        "line 2, column sampling_rate",
        "12.345 has a point, and numbers have a decimal comma here (line 2, column resample)",
    ),
    "decimal comma between tabs": (
        "name\tfile\tsampling_rate\na\t1.csv\t0,5\n", "sampling_rate", "0,5 cannot be used"
    ),
    "Excel, a missing value": (HEADER + "a,1.csv,#N/A\n", "sampling_rate", "#N/A"),
    "Excel, a broken reference": (HEADER + "a,1.csv,#REF!\n", "sampling_rate", "#REF!"),
    "Excel, a division by zero": (HEADER + "a,1.csv,#DIV/0!\n", "sampling_rate", "#DIV/0!"),
    "Excel, a formula": (HEADER + 'a,1.csv,="100"\n', "sampling_rate", "cannot be used"),
    "a number with its unit": (HEADER + "a,1.csv,100 Hz\n", "sampling_rate", "100 Hz"),
    "an underscore in a number": (HEADER + "a,1.csv,1_000\n", "sampling_rate", "1_000"),
    "hexadecimal": (HEADER + "a,1.csv,0x64\n", "sampling_rate", "0x64' cannot be used"),
    "digits of another script": (HEADER + "a,1.csv,١٠٠\n", "sampling_rate", "cannot be used"),
    "nan": (HEADER + "a,1.csv,nan\n", "sampling_rate", "not a finite number"),
    "Infinity": (HEADER + "a,1.csv,-Infinity\n", "sampling_rate", "not a finite number"),
    "above all numbers": (HEADER + "a,1.csv,1e400\n", "sampling_rate", "not a finite number"),
    "denormal": (HEADER + "a,1.csv,1.0e-320\n", "sampling_rate", "is below"),
    "401 digits": (HEADER + f"a,1.csv,1{'0' * 400}\n", "sampling_rate", "not a finite number"),
    "5000 digits": (HEADER + f"a,1.csv,{'7' * 5000}\n", "sampling_rate", "not a finite number"),
    "5000 digits in a list": (
        f'name,file,orders.nc\na,1.csv,"[2, {"7" * 5000}]"\n', "orders.nc", "5000 digits"
    ),
    "a date in a list": (
        'name,file,orders.nc\na,1.csv,"[2, 2024-13-45]"\n', "orders.nc", "as a date"
    ),
    "an octal number in a list": (
        'name,file,orders.nc\na,1.csv,"[2, 010]"\n', "orders.nc", "010 as 8"
    ),
    "a tag in a list": ('name,file,orders.nc\na,1.csv,"[!!int x, 3]"\n', "orders.nc", "!!int"),
    "many brackets": (f"name,file,orders.nc\na,1.csv,{'[' * 3000}\n", "orders.nc", "is no list"),
    "a mapping": ('name,file,orders\na,1.csv,"{nc: [2, 3]}"\n', "orders", "cannot be used"),
    "a key and one below it": (
        "name,file,split,split.discard\na,1.csv,3,4\n", "line 1", "split and split.discard"
    ),
    "a key and one far below it": (
        "name,file,a.b.c,a\na,1.csv,3,4\n", "line 1", "the columns a and a.b.c"
    ),
    "two dots": ("name,file,split..discard\na,1.csv,3\n", "line 1", "a dot too many"),
    "a dot at the end": ("name,file,split.\na,1.csv,3\n", "line 1", "a dot too many"),
    "many dots": (f"name,file,{'a.' * 3000}a\na,1.csv,3\n", "recordings.csv", "; "),
    "a header in capitals": ("Name,File\na,1.csv\n", "line 1", "did you mean Name?"),
    "two names": ("name,file,name\na,1.csv,b\n", "line 1", "two columns are called 'name'"),
    "UTF-16 without a byte order mark": (PLAIN.encode("utf-16-le"), "", "null characters"),
    "UTF-16 with half a character": (
        PLAIN.encode("utf-16") + b"\x00", "", "is not UTF-16"
    ),
    "UTF-32": (PLAIN.encode("utf-32"), "", "save the table as UTF-8"),
    "Latin-1": ("name,file\na,Größe.csv\n".encode("latin-1"), "", "is not UTF-8"),
    "an Excel workbook": (b"PK\x03\x04\x14\x00\x06\x00\x08\x00\x00\x00!\x00\xff", "", "UTF-8"),
    "an open quotation mark": ('name,file\na,"1.csv\n', "", "this is not a table"),
    "a field of 200 000 characters": (
        f"name,file\na,{'x' * 200_000}\n", "", "this is not a table"
    ),
    "nothing but sep=;": ("sep=;\n", "", "no data sets in it"),
    "nothing but a byte order mark": (b"\xef\xbb\xbf", "", "no data sets in it"),
    "the wrong sep": ("sep=;\n" + PLAIN, "line 2", "there is no column name"),
    "spaces as separators": ("name file\na 1.csv\n", "line 1", "there is no column name"),
    "a shorter row": (HEADER + "a,1.csv\n", "line 2", "2 fields and the header 3"),
    "a longer row": (HEADER + "a,1.csv,100,x\n", "line 2", "4 fields and the header 3"),
    "JSON lines": ('{"name": "a", "file": "1.csv"}\n{"name": "b"}\n', "line", "; "),
    "a null character in a path": ("name,file\na,1\0.csv\n", "", "null characters"),
    "a row twice": ("name,file\na,1.csv\na,1.csv\n", "line 3, column name", "second time"),
    "comments": ("# fleet\nname,file\na,1.csv\n", "line", "; "),
    "units in a second row": ("name,file,sampling_rate\n,,Hz\na,1.csv,100\n", "line 2", "no name"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_certain_is_refused_with_its_place(case):
    content, place, said = REFUSED[case]
    before = time.process_time()
    with pytest.raises(InputError) as caught:
        completed(content)
    assert time.process_time() - before < 5
    sentence = str(caught.value)
    assert re.fullmatch(r"recordings\.csv.*: .+; .+\.", sentence)
    assert place in sentence
    assert said in sentence
    assert len(sentence) < 20_000


def test_channels_may_be_called_anything():
    """A channel's name stays text, where a number would be another channel."""
    text = "name,file,input,output,time\na,1.csv,1_2,nan,inf\nb,2.csv,2.0,1,03\nc,3.csv,1e1,0x1,t\n"
    channels = {name: each.source.channels for name, each in completed(text).items()}
    assert [(*each.inputs, *each.outputs, each.time) for each in channels.values()] == [
        ("1_2", "nan", "inf"),
        (2, 1, 3),
        ("1e1", "0x1", "t"),
    ]


def test_a_hundred_thousand_columns_are_refused_in_seconds():
    columns = [f"c{number}" for number in range(100_000)]
    before = time.process_time()
    with pytest.raises(InputError, match="there is no such key"):
        completed(f"name,file,{','.join(columns)}\na,1.csv{',1' * len(columns)}\n")
    assert time.process_time() - before < 10


def test_what_is_no_regular_file_is_refused_without_being_opened(tmp_path):
    import os

    os.mkfifo("pipe.csv")
    Path("folder.csv").mkdir()
    for name in ("pipe.csv", "folder.csv"):
        with pytest.raises(InputError, match=f"^{name}: is not a regular file; .+"):
            complete({"datasets": name})


@pytest.mark.parametrize("name", ["missing.csv", "x" * 300, "nul\0l.csv", "\ud800.csv", " "])
def test_a_path_that_leads_nowhere_is_refused(name):
    with pytest.raises(InputError, match=r": .+; .+\."):
        complete({"datasets": name})
