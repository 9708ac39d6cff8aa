"""One machine code for all processors that have it."""

import pytest

from evopem.config.configuration import blas_code


@pytest.mark.parametrize(
    ("flags", "code"),
    [
        ("flags\t\t: fpu sse2 fma avx avx2 avx512f", {"OPENBLAS_CORETYPE": "Haswell"}),
        ("flags\t\t: fpu sse2 avx", {}),
        ("Features\t: fp asimd sve", {}),
    ],
)
def test_newer_processors_take_the_code_for_avx2_and_others_their_own(tmp_path, flags, code):
    (tmp_path / "cpuinfo").write_text(f"processor\t: 0\n{flags}\n")
    assert blas_code(tmp_path / "cpuinfo") == code


def test_a_processor_that_cannot_be_asked_takes_its_own(tmp_path):
    assert blas_code(tmp_path / "missing") == {}
