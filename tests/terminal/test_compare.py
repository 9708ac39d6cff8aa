"""`evopem compare`: folders of results in, one page out."""

import re
import shutil

import pytest

from evopem.terminal.command import main


@pytest.fixture
def folders(identified, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        shutil.copytree(identified.files.folder, tmp_path / "results" / name)
        config = tmp_path / "results" / name / "config.yaml"
        config.write_text(config.read_text().replace("bench:", f"{name}:"))
    (tmp_path / "results" / "a" / "report.html").touch()
    return tmp_path


def test_the_page_has_errors_overlays_modes_and_checks(folders, capsys):
    assert main(["compare", "results/a", "results/b/", "--page", "pages.html"]) == 0
    printed = capsys.readouterr().out
    assert "All models were validated on the same samples." in printed
    assert printed.endswith("  page  pages.html\n")
    page = (folders / "pages.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 3
    assert re.findall('data-name="([A-Z][^"]*)"', page) == [
        *("Errors and verdicts", "Measured and simulated", "Frequency responses", "Modes"),
        *("Modes matched", "Checks"),
    ]
    assert 'href="results/a/report.html"' in page
    assert "results/b/report.html" not in page
    assert "src=" not in re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["results/a"], "compare: there are 1 models; give 2 to 6 of them."),
        (["results/a", "results/c"], "results/c: holds no results of a data set;"),
    ],
)
def test_what_cannot_be_compared_is_said_in_a_sentence(folders, capsys, arguments, sentence):
    assert main(["compare", *arguments]) == 1
    assert capsys.readouterr().err.startswith(sentence)
    assert not (folders / "comparison.html").exists()
