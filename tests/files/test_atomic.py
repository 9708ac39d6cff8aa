"""Files are written completely or not at all, and exactly."""

import numpy as np
import pandas as pd
import pytest

from evopem.errors import InputError
from evopem.files.atomic import atomic_write, write_table, write_text


def test_a_file_whose_writing_fails_stays_as_it_was(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")
    with pytest.raises(UnicodeEncodeError), atomic_write(path) as temporary:
        temporary.write_text("half of it \udc00", encoding="utf-8")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "results").write_text("a file where a folder is needed")
    with pytest.raises(InputError, match=r"x\.txt: cannot be written \("):
        write_text(tmp_path / "results" / "x.txt", "text")


@pytest.mark.parametrize("as_frame", [True, False])
def test_tables_are_exact(tmp_path, as_frame):
    generator = np.random.default_rng(1)
    table = {
        "count": np.arange(50),
        "value": generator.normal(size=50) * 10.0 ** generator.integers(-300, 300, 50),
        "name": [f'a "b", {i}' for i in range(50)],
        "chosen": generator.random(50) < 0.5,
    }
    table["value"][7] = np.nan
    path = tmp_path / "table.csv"
    write_table(path, pd.DataFrame(table) if as_frame else table)
    read = pd.read_csv(path)
    pd.testing.assert_frame_equal(read, pd.DataFrame(table), check_exact=True)
    assert path.read_text().splitlines()[8].split(",")[1] == ""
