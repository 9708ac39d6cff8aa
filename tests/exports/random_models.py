"""Models of every structure with random coefficients, channels and transforms, as results are."""

from dataclasses import replace

import numpy as np

from evopem.estimation.model_record import ModelRecord, derived_from
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel, model_of
from evopem.models.state_space import StateSpaceModel
from evopem.signals.prepared_data import StretchOrigin, Transforms
from evopem.signals.transforms import difference

STRUCTURES = (
    *("fir", "arx", "arma", "armax", "ararx", "ararmax", "oe", "bj", "general"),
    *("ss", "ss_oe", "ss_bj", "ss outputs"),
)
RATE = 50.0


def stable(generator, degree):
    """A monic polynomial whose roots lie within radius 0.9."""
    roots = generator.uniform(-0.9, 0.9, degree).astype(complex)
    pairs = generator.integers(0, degree // 2 + 1)
    for k in range(pairs):
        root = generator.uniform(0.3, 0.9) * np.exp(1j * generator.uniform(0.2, 2.9))
        roots[2 * k : 2 * k + 2] = root, root.conj()
    return np.atleast_1d(np.poly(roots).real)


def polynomials(generator, structure, inputs) -> PolynomialModel:
    """A stable model of a structure, its level included."""
    has = {"fir": "b", "arx": "ab", "arma": "ac", "armax": "abc", "ararx": "abd"}
    has |= {"ararmax": "abcd", "oe": "bf", "bj": "bcdf", "general": "abcdf"}

    def order(letter, low=1):
        return int(generator.integers(low, 4)) if letter in has[structure] else 0

    m = inputs if "b" in has[structure] else 0
    orders = Orders(
        structure,
        na=order("a"),
        nb=tuple(order("b") for _ in range(m)),
        nc=order("c"),
        nd=order("d"),
        nf=tuple(order("f", 0) for _ in range(m)),
        nk=tuple(int(generator.integers(0, 3)) for _ in range(m)),
    )
    model = model_of(orders, generator.standard_normal(orders.parameters), sampling_rate=RATE)
    monic = {letter.upper(): stable(generator, getattr(orders, f"n{letter}")) for letter in "acd"}
    f = tuple(stable(generator, degree) for degree in orders.nf)
    return replace(
        model, **monic, F=f, level=float(generator.standard_normal()), noise_variance=1.0
    )


def state_space(generator, form, inputs) -> StateSpaceModel:
    """A stable model of some outputs, with delays, whose predictor is stable, too."""
    n, ny = int(generator.integers(1, 7)), int(generator.integers(1, 4))
    m = 0 if form == "ss outputs" else inputs
    basis = np.linalg.qr(generator.standard_normal((n, n)))[0]
    C = generator.standard_normal((ny, n))
    A = basis * generator.uniform(-0.9, 0.9, n) @ basis.T
    K = 0.1 * generator.standard_normal((n, ny)) * (form != "ss_oe")
    while np.abs(np.linalg.eigvals(A - K @ C)).max() > 0.95:
        K *= 0.5
    delays = tuple(int(k) for k in generator.integers(0, 4, m))
    return StateSpaceModel(
        *(A, generator.standard_normal((n, m)), C, generator.standard_normal((ny, m)), K, RATE),
        *(generator.standard_normal(ny), np.eye(ny), delays if any(delays) else ()),
        structure="ss_oe" if form == "ss_oe" else "ss",
    )


def transforms_of(generator, model, kind) -> Transforms:
    """Transforms of one kind, with levels and initial values of their own."""
    counts = {"differences": (2, 2), "output differences": (1, 0), "input differences": (0, 1)}
    counts["high pass"] = (1, 1)
    times, times_input = counts.get(kind, (0, 0))

    def rows(count, channels):
        return difference(generator.standard_normal((count, channels)), count)[1] if count else ()

    def numbers(channels):
        return tuple(generator.standard_normal(channels).tolist())

    m, ny = model.inputs, model.outputs
    bent = kind == "Box-Cox" and ny == 1
    origin = StretchOrigin(
        *(0, 30, 0.6, 100, (0.01,) * m if bent else numbers(m), (1.4,) if bent else numbers(ny)),
        *(rows(times_input if m else 0, m), rows(times, ny)),
    )
    return Transforms(
        *(RATE, 2.5 * RATE, (origin,), (), "cut"),
        box_cox=float(generator.choice([0.0, 0.3, -0.1])) if bent else None,
        shift=3.0 if bent else 0.0,
        difference=times,
        difference_input=times_input,
        difference_pole=0.9 if kind == "high pass" else 0.0,
        input_trends=numbers(m) if kind == "trend" else (),
        output_trends=numbers(ny) if kind == "trend" else (),
    )


def random_record(like: ModelRecord, number: int) -> ModelRecord:
    """The record of a random model; consecutive numbers have all structures and transforms."""
    generator = np.random.default_rng(number)
    structure = STRUCTURES[number % len(STRUCTURES)]
    kinds = ("levels", "differences", "output differences", "input differences", "high pass")
    kinds += ("trend", "Box-Cox")
    inputs = int(generator.integers(1, 4))
    if structure.startswith("ss"):
        model = state_space(generator, structure, inputs)
        states = model.order
    else:
        model, states = polynomials(generator, structure, inputs), 0
    return replace(
        like,
        **derived_from(model, states),
        structure=structure.partition(" ")[0],
        input_names=tuple(f"u{k} */ \\ é" for k in range(model.inputs)),
        output_names=tuple(f"y{k}" for k in range(model.outputs)),
        input_units=("N m",) * model.inputs,
        output_units=("",) * model.outputs,
        fit_percent=(50.0,) * model.outputs,
        transforms=transforms_of(generator, model, kinds[number % len(kinds)]),
    )
