"""The model as an equation and as statements of other programs."""

import json

import numpy as np
import pytest
from browsing import told
from covariances import covariance_of_matrix
from markupsafe import Markup

from evopem.models.polynomial import PolynomialModel
from evopem.report import equations

MODEL = PolynomialModel(
    A=np.array([1.0, -1.5, 0.7]),
    B=np.array([0.5, -0.25]),
    C=np.array([1.0, 0.3]),
    nk=3,
    sampling_rate=100.0,
    noise_variance=0.01,
    covariance=covariance_of_matrix(np.diag([0.1, 0.2, 0.3, 0.4, 0.5]) ** 2),
)


def plain(markup):
    return " ".join(markup.striptags().split())


def shown_polynomials(model):
    found = equations.polynomials(model)
    return {name: plain(Markup(told("polynomial", terms)[0])) for name, terms in found}


def test_polynomials_start_b_at_its_delay():
    assert shown_polynomials(MODEL) == {
        "A": "1 − 1.5 q−1 + 0.7 q−2",
        "B": "0.5 q−3 − 0.25 q−4",
        "C": "1 + 0.3 q−1",
    }


def test_the_smallest_model_has_an_equation():
    smallest = PolynomialModel(np.ones(1), np.array([-2.0]), np.ones(1), structure="armax")
    assert shown_polynomials(smallest) == {"A": "1", "B": "−2", "C": "1"}


def test_python_statement_makes_the_transfer_function():
    pytest.importorskip("control", reason="python-control is not installed")
    scope = {}
    exec(equations.python(MODEL), scope)
    z = np.exp(0.3j)
    expected = (0.5 * z**-3 - 0.25 * z**-4) / (1 - 1.5 * z**-1 + 0.7 * z**-2)
    assert scope["G"](z) == pytest.approx(expected)
    assert scope["G"].dt == 0.01


def test_matlab_statement_has_the_delay_as_leading_zeros():
    lines = [line.strip() for line in equations.matlab(MODEL).split("...\n")]
    assert lines == [
        "model = idpoly([1 -1.5 0.69999999999999996],",
        "[0 0 0 0.5 -0.25],",
        "[1 0.29999999999999999],",
        "1,",
        "1,",
        "0.01,",
        "0.01);",
    ]


def test_coefficients_with_their_lags_and_errors():
    table = equations.coefficient_table(MODEL)
    assert [(plain(name), lag, value) for name, lag, value, _ in table] == [
        ("A", 1, -1.5),
        ("A", 2, 0.7),
        ("B", 3, 0.5),
        ("B", 4, -0.25),
        ("C", 1, 0.3),
    ]
    assert [error for *_, error in table] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    undelayed = PolynomialModel(np.ones(1), np.array([2.0, 1.0]), np.ones(1))
    table = equations.coefficient_table(undelayed)
    assert [row[1:] for row in table] == [(0, 2.0, None), (1, 1.0, None)]


def test_plain_text_and_json_give_the_model_back():
    model = PolynomialModel(
        np.array([1.0, -0.123456789012]),
        np.array([0.5, -2e-7]),
        np.array([1.0, 0.25]),
        nk=3,
        sampling_rate=100.0,
        noise_variance=0.01,
    )
    assert equations.text(model).splitlines() == [
        "A(q) y(t) = B(q) u(t) + C(q) e(t)",
        "A(q) = 1 - 0.123456789 q^-1",
        "B(q) = 0.5 q^-3 - 2e-07 q^-4",
        "C(q) = 1 + 0.25 q^-1",
        "variance of e = 0.01",
        "sampling rate = 100 Hz",
    ]
    assert json.loads(equations.as_json(model)) == {
        "orders": {
            "na": 1,
            "nb": [2],
            "nc": 1,
            "nd": 0,
            "nf": [0],
            "nk": [3],
            "structure": "armax",
        },
        "a": [1.0, -0.123456789012],
        "b": [0.5, -2e-7],
        "c": [1.0, 0.25],
        "noise_variance": 0.01,
        "sampling_rate": 100.0,
    }


def box_jenkins():
    return PolynomialModel(
        A=np.ones(1),
        B=np.array([0.5]),
        C=np.array([1.0, 0.2]),
        D=np.array([1.0, -0.7]),
        F=np.array([1.0, -0.9]),
        nk=1,
        level=0.25,
        noise_variance=0.01,
    )


def test_a_box_jenkins_model_has_its_own_equation():
    model = box_jenkins()
    assert plain(equations.equation(model)) == "y(t) = B(q)/F(q) u(t) + C(q)/D(q) e(t) + level"
    assert [letter for letter, _ in equations.polynomials(model)] == ["B", "C", "D", "F"]


def test_matlab_is_given_every_polynomial():
    statement = equations.matlab(box_jenkins())
    parts = [line.strip() for line in statement.split("...\n")]
    assert parts[3:5] == ["[1 -0.69999999999999996],", "[1 -0.90000000000000002],"]
    assert "level = 0.25;" in statement
    alone = PolynomialModel(np.array([1.0, -0.5]), np.empty(0), np.array([1.0, 0.3]))
    assert "[], ..." in equations.matlab(alone)
    assert "H = control.tf(" in equations.python(alone)


def test_a_model_of_two_inputs_has_its_equation():
    pytest.importorskip("control", reason="python-control is not installed")
    model = PolynomialModel(
        np.array([1.0, -0.5]),
        ([1.0, 0.2], [0.3]),
        np.array([1.0, 0.1]),
        nk=(1, 2),
        sampling_rate=10.0,
    )
    assert plain(equations.equation(model)) == ("A(q) y(t) = B1(q) u1(t) + B2(q) u2(t) + C(q) e(t)")
    assert [name for name, _ in equations.polynomials(model)] == ["A", "B1", "B2", "C"]
    note = plain(equations.orders_note(model))
    assert note.endswith("nb2 = 1 is the number of B2 coefficients, the first at lag nk2 = 2.")
    assert "{[0 1 0.20000000000000001], [0 0 0.29999999999999999]}" in equations.matlab(model)
    scope = {}
    exec(equations.python(model), scope)
    z = np.exp(0.3j)
    expected = [(z**-1 + 0.2 * z**-2), 0.3 * z**-2] / (1 - 0.5 * z**-1)
    assert np.ravel(scope["G"](z)) == pytest.approx(expected)


def test_a_state_space_model_has_the_terms_that_it_has():
    full = plain(Markup(told("state_space", True, True)[0]))
    assert full == "x(t + 1) = A x(t) + B u(t) + K e(t)y(t) = C x(t) + D u(t) + e(t)"
    of_plant = plain(Markup(told("state_space", True, False)[0]))
    assert of_plant.startswith("x(t + 1) = A x(t) + B u(t)y(t)")
