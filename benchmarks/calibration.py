"""How often each statement of a report is true, on random recordings; writes docs/evidence.

    python benchmarks/calibration.py [--cases 500] [--first 0] [--processes 2] [--single]
    python benchmarks/calibration.py --first 5000    # several channels, and outputs alone

Every case goes through the whole automatic recipe with nothing given but the signals and the
sampling rate. What the report then says is compared with the system that made the recording. One
line for each case is kept in results/calibration.jsonl, and a case that stands there is not run
again, so that a night can be interrupted.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from evidence import write_section
from numpy.typing import NDArray
from random_systems import SEVERAL, Case, draw_case
from scipy.stats import binomtest
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

import evopem  # noqa: E402
from evopem.config.settings import Objective, SearchSettings  # noqa: E402
from evopem.errors import InputError  # noqa: E402
from evopem.models.modes import assurance  # noqa: E402
from evopem.report.verdict import verdict  # noqa: E402

COMMAND = "benchmarks/calibration.py"
KEPT = ROOT / "results" / "calibration.jsonl"
RATE = 100.0  # Hz
NORMAL_95 = 1.959963984540054
# Frequencies of the excited band at which a response is compared.
FREQUENCIES = 200
# A mode of the model is that of the system within these shares of frequency and damping.
SAME_FREQUENCY, SAME_DAMPING = 0.05, 0.5
# Share of the energy, and signal to noise, from which on a mode should have been found.
VISIBLE_SHARE, VISIBLE_RATIO = 0.02, 2.0
# Least standard errors, half of what a mode may be off by, from which on the record tells it.
TOLD_FREQUENCY, TOLD_DAMPING = SAME_FREQUENCY / 2.0, SAME_DAMPING / 2.0
# The same of the delay, in samples of the model, which may be off by two.
MOST_OFF, TOLD_DELAY = 2.0, 1.0
# As many likely delays at most are a statement of the delay.
FEW_DELAYS = 3
# Share of noise in the variance of an input from which on feedback should be found, and what it
# comes to in squared standard errors of a correlation where the record tells it.
FED_BACK, TOLD_FEEDBACK = 0.01, 16.0
# Share of the power of an input in the band that is called excited; the rest is half on each side.
EXCITED_SHARE = 0.99
# Structures of polynomials whose true orders an oracle may be given.
ORACLES = {"fir", "arx", "armax", "oe", "bj"}

Line = dict[str, Any]
Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


def run(number: int) -> Line:
    """One case: what it is, what the report says, and what is true."""
    case = draw_case(number)
    line: Line = {"case": number, **case.labels}
    started = time.process_time()
    try:
        with threadpool_limits(1), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = evopem.identify(
                case.inputs if case.inputs.shape[1] else None,
                case.outputs,
                RATE,
                show_progress=False,
            )
            line |= judged(case, found)
            line["seconds"] = round(time.process_time() - started, 1)
            if not case.outside and case.system.structure in ORACLES and _is_single(case):
                with suppress(InputError):  # where the true orders are lost in rounding
                    line["oracle"], line["excited"] = _of_oracle(case, found)
                    line["efficient"] = oracle(case, "quadratic")
                    if line.get("decimation") == 1.0:
                        line["prepared"] = of_prepared(case, found)
    except InputError as error:
        line["refused"] = str(error)
    except Exception as error:
        # A fault of the package is a row of the table.
        line["fault"] = f"{type(error).__name__}: {error}"
    return line


def _is_single(case: Case) -> bool:
    return case.inputs.shape[1] == 1 == case.outputs.shape[1]


def judged(case: Case, found: Any) -> Line:
    """What a report says, and what is true of it."""
    uses = {str(use.key): use.answer for use in verdict(found.results).uses}
    named = {
        "simulation": uses.get("simulation", ""),
        "response": uses.get("frequency_response", ""),
        "spectrum": uses.get("spectrum", ""),
        "errors": uses["standard_errors"],
    }
    line: Line = {
        "chosen": str(found.summary.orders or f"{found.model.structure} {found.model.order}"),
        "verdict": named,
        "checks": {check.name: check.passed for check in found.checks},
        "simulation_error": found.simulation_error_percent,
    }
    if not case.outside:
        line["modes"] = modes_of(case, found)
        line["shapes"] = shapes_of(case, found)
        if case.inputs.shape[1]:
            line |= response_of(case, found)
            # Samples of the recording, which may be decimated for the model.
            factor = RATE / found.model.sampling_rate
            line["decimation"] = round(factor, 1)
            line["delays"] = [round(nk * factor, 1) for nk in delays_of(found.model)]
            line["delay_error"] = case.delay_error()
            likely = found.results.decisions.likely_delays
            line["likely"] = [[round(nk * factor, 1) for nk in delays] for delays in likely]
    return line


def delays_of(model: Any) -> list[int]:
    """Delay of each input in samples of the model."""
    if hasattr(model, "delays"):
        # A matrix D of zeros is one sample of delay more.
        return [int(nk) + (not np.any(model.D)) for nk in model.delays]
    return [int(each) for each in np.atleast_1d(model.nk)]


def response_of(case: Case, found: Any) -> Line:
    """Error of the frequency response in the excited band, and what its intervals cover.

    The frequencies are those of the oracle.
    """
    model = found.model
    angles = np.geomspace(*case.band, FREQUENCIES)
    angles = angles[angles < np.pi * model.sampling_rate / RATE]
    if not len(angles):
        return {}
    frequencies = angles * RATE / (2.0 * np.pi)
    true = case.system.frequency_response(angles) * case.output_scales[:, None] / case.input_scale
    estimate = model.frequency_response(frequencies)
    bound = np.nan
    if case.system.structure != "fir":
        bound = case.response_error(angles)
    gain, off = np.abs(np.log(np.abs(true / estimate))), np.abs(np.angle(true / estimate))
    widths = [bands(frequencies, pair) for pair in pairs_of(found.results.frequency_response)]
    shape = true.shape[1:]
    of_gain, of_phase = (np.array(each).T.reshape(-1, *shape) for each in zip(*widths, strict=True))
    pairs = [(j, i) for j in range(shape[0]) for i in range(shape[1])]
    return {
        "response_error": _mean(_relative(estimate[:, j, i], true[:, j, i]) for j, i in pairs),
        "bound": bound,
        "gain": float(np.mean(gain <= of_gain)),
        "phase": float(np.mean(off <= of_phase)),
    }


def pairs_of(table: pd.DataFrame) -> list[pd.DataFrame]:
    """The rows of each pair of output and input, in the order of the table."""
    return [pair for _, pair in table.groupby(["output", "input"], sort=False)]


def bands(frequencies: Real, pair: pd.DataFrame) -> tuple[Real, Real]:
    """Half widths of 95 % bands of ln(gain) and of the phase, in radians, at some frequencies."""
    with np.errstate(divide="ignore", invalid="ignore"):
        of_gain = np.log(pair["gain_upper"] / pair["gain"])
    of_phase = NORMAL_95 * np.radians(pair["phase_se_deg"])
    return tuple(np.interp(frequencies, pair["frequency_hz"], half) for half in (of_gain, of_phase))


def _relative(estimate: Complex, true: Complex) -> float:
    return float(np.linalg.norm(estimate - true) / np.linalg.norm(true))


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def modes_of(case: Case, found: Any) -> Line:
    """Which modes that can be trusted are true, and which true ones are trusted."""
    true = _true_modes(case)
    trusted = found.modes[found.modes["trusted"]]
    names = ("frequency_hz", "frequency_se_hz", "damping_percent", "damping_se_percent")
    rows = [tuple(map(float, row)) for row in trusted[list(names)].to_numpy()]
    near = [_nearest(frequency, damping / 100.0, true) for frequency, _, damping, _ in rows]
    within = [
        _nearest(frequency, damping / 100.0, true, 3.0 * damping_se / 100.0)
        for frequency, _, damping, damping_se in rows
    ]
    covered = [
        (
            abs(frequency - true[at][0]) <= NORMAL_95 * frequency_se,
            abs(damping / 100.0 - true[at][1]) <= NORMAL_95 * damping_se / 100.0,
        )
        for (frequency, frequency_se, damping, damping_se), at in zip(rows, near, strict=True)
        if at is not None and np.isfinite(frequency_se)
    ]
    visible = [k for k, mode in enumerate(true) if mode[2] >= VISIBLE_SHARE]
    if case.signal_to_noise < VISIBLE_RATIO:
        visible = []
    told = visible
    if visible:
        errors = case.mode_errors()
        limits = TOLD_FREQUENCY, TOLD_DAMPING
        told = [k for k in visible if np.all(np.array(errors[k]) < limits)]
    return {
        "trusted": len(rows),
        "false": sum(at is None for at in near),
        "far": sum(at is None for at in within),
        "visible": len(visible),
        "missed": len([k for k in visible if k not in near]),
        "told": len(told),
        "missed_told": len([k for k in told if k not in near]),
        "missed_far": len([k for k in told if k not in near and k not in within]),
        "frequency": [sum(bool(each[0]) for each in covered), len(covered)],
        "damping": [sum(bool(each[1]) for each in covered), len(covered)],
    }


def shapes_of(case: Case, found: Any) -> list[Line]:
    """Of each trusted shape: its MAC with the true one, what was expected, and entries covered.

    The true shape is scaled to 1 where the other is 1 by definition.
    """
    lines, true = [], _true_modes(case)
    for evidence in found.results.validation.modes.modes:
        mode = evidence.mode
        at = _nearest(mode.frequency_hz, mode.damping_ratio, true) if evidence.trusted else None
        if at is None or len(mode.shape) == 1 or not np.isfinite(case.modes[at].shape).all():
            continue
        largest = int(np.argmax(np.abs(mode.shape)))
        off = case.modes[at].shape / case.modes[at].shape[largest] - mode.shape
        inside = [
            np.abs(part) <= NORMAL_95 * error
            for part, error in ((off.real, mode.shape_se_real), (off.imag, mode.shape_se_imag))
        ]
        covered = int(np.sum(np.delete(inside, largest, axis=1)))
        lines.append(
            {
                "trusted": evidence.shape_trusted,
                "mac": assurance(mode.shape, case.modes[at].shape),
                "expected": mode.shape_assurance,
                "covered": [covered, 2 * (len(mode.shape) - 1)],
            }
        )
    return lines


def _true_modes(case: Case) -> list[tuple[float, float, float]]:
    """Frequency in Hz, damping and share of each mode."""
    return [(mode.angle * RATE / (2.0 * np.pi), mode.damping, mode.share) for mode in case.modes]


def _nearest(
    frequency: float,
    damping: float,
    true: Sequence[tuple[float, float, float]],
    uncertain: float = 0.0,
) -> int | None:
    """The mode of the system that a mode of the model is, its damping within bounds or errors."""
    near = [
        (abs(np.log(frequency / each[0])), k)
        for k, each in enumerate(true)
        if abs(frequency / each[0] - 1.0) < max(SAME_FREQUENCY, each[1])
        and abs(damping - each[1]) < max(SAME_DAMPING * each[1], 0.01, uncertain)
    ]
    return min(near)[1] if near else None


def _of_oracle(case: Case, found: Any) -> tuple[float, list[float]]:
    """Error of the oracle, and those of the report and of the oracle in the excited band."""
    clean, excited = _without_faults(case), excited_band(case)
    model = _oracle_model(clean, "absolute")
    narrow = [error_of(found.model, case, excited), error_of(model, clean, excited)]
    return error_of(model, clean, case.band), narrow


def excited_band(case: Case) -> tuple[float, float]:
    """The part of the compared band where a recorded input has nearly all its power."""
    u = case.clean[0][:, 0]
    power = np.cumsum(np.abs(np.fft.rfft(u - u.mean())) ** 2)
    outside = 0.5 * (1.0 - EXCITED_SHARE) * power[-1]
    low, high = np.searchsorted(power, (outside, power[-1] - outside)) * 2.0 * np.pi / len(u)
    return max(float(low), case.band[0]), min(float(high), case.band[1])


def oracle(case: Case, objective: Objective = "absolute") -> float:
    """Error of the frequency response of the true structure and orders, without the faults.

    Its errors are absolute, as is the default; the likelihood of this noise is that of squares.
    """
    clean = _without_faults(case)
    return error_of(_oracle_model(clean, objective), clean, case.band)


def _without_faults(case: Case) -> Case:
    return replace(case, input_scale=1.0, output_scales=np.ones(1))


def _oracle_model(clean: Case, objective: Objective) -> Any:
    u, y = clean.clean
    count = round(0.8 * len(y))
    return true_orders(clean, objective, u[:count, 0], y[:count, 0], sampling_rate=RATE)


def of_prepared(case: Case, found: Any) -> float:
    """The same from the samples, with their faults, that the recipe has prepared for its model."""
    objective = next(d.choice for d in found.decisions if d.subject == "objective")
    model = true_orders(case, objective, found.results.prepared.estimation, level=True)
    return error_of(model, case, case.band)


def true_orders(case: Case, objective: Objective, *signals: Any, **options: Any) -> Any:
    """The model of the true structure and orders from some signals."""
    b, f = case.system.polynomials
    lags, n = int(np.flatnonzero(b)[-1]) + 1, len(f) - 1
    c, d = len(case.system.c) - 1, len(case.system.d) - 1
    nk = case.system.nk
    structure = case.system.structure
    orders = {
        "fir": (lags, nk),
        "arx": (n, lags, nk),
        "armax": (n, lags, c, nk),
        "oe": (lags, n, nk),
        "bj": (lags, c, d, n, nk),
    }[structure]
    options |= {"structure": structure, "settings": SearchSettings(objective=objective)}
    return evopem.estimate(*signals, orders=orders, **options).model


def error_of(model: Any, case: Case, band: tuple[float, float]) -> float:
    """Error of the frequency response of a model in a band, as far as it has one; NaN in none."""
    angles = np.geomspace(*band, FREQUENCIES)
    angles = angles[angles < np.pi * model.sampling_rate / RATE]
    if band[0] >= band[1] or not len(angles):
        return float("nan")
    response = model.frequency_response(angles * RATE / (2.0 * np.pi))[:, 0, 0]
    scale = case.output_scales[0] / case.input_scale
    return _relative(response, scale * case.system.frequency_response(angles)[:, 0, 0])


def rate(hits: Iterable[bool]) -> str:
    """A rate in percent, with Wilson's 95 % interval and the number of trials."""
    outcomes = list(hits)
    return of_counts(sum(outcomes), len(outcomes))


def of_counts(hits: int, trials: int) -> str:
    """The same, of counts."""
    if not trials:
        return "–"
    low, high = binomtest(hits, trials).proportion_ci(method="wilson")
    return f"{100 * hits / trials:.1f} ({100 * low:.1f} to {100 * high:.1f}) of {trials}"


def shares(lines: Iterable[Line], key: str) -> str:
    """Mean share of covered frequencies in percent, with the number of recordings."""
    values = [100.0 * line[key] for line in lines if key in line]
    if not values:
        return "–"
    half = NORMAL_95 * np.std(values) / np.sqrt(len(values))
    return f"{np.mean(values):.1f} ± {half:.1f} of {len(values)}"


def pooled(lines: Iterable[Line], key: str) -> str:
    """Rate over all modes of all recordings."""
    counts = np.array([line["modes"][key] for line in lines if "modes" in line]).reshape(-1, 2)
    return of_counts(*map(int, counts.sum(axis=0)))


def table(lines: Sequence[Line]) -> list[tuple[str, str]]:
    """A row for each statement: how often it is true."""
    done = [line for line in lines if "checks" in line]
    inside = [line for line in done if not line["outside"]]
    outside = [line for line in done if line["outside"]]
    good = [line for line in inside if line["verdict"]["errors"] == "good"]
    driven = [line for line in inside if "response_error" in line]
    said = [line for line in driven if line["verdict"]["response"] == "good"]
    with_oracle = [line for line in driven if "oracle" in line]
    with_delays = [line for line in driven if line["delays"]]
    sets = [(delays, line) for line in driven for delays in line.get("likely", ())]
    trusted = [line["modes"] for line in inside]
    shapes = [shape for line in inside for shape in line.get("shapes", ()) if shape["trusted"]]
    unrelated = [line for line in outside if line["outside"] == "unrelated"]
    groups = (("all", inside), ("response “good”", said), ("standard errors “good”", good))
    return [
        ("recordings refused", rate("refused" in line and "checks" not in line for line in lines)),
        ("recordings that ended in a fault", rate("fault" in line for line in lines)),
        *(
            (f"{what} covers, {where}", measure(group, key))
            for where, group in groups
            for what, key, measure in (
                ("interval of the gain", "gain", shares),
                ("interval of the phase", "phase", shares),
                ("interval of the frequency of a trusted mode", "frequency", pooled),
                ("interval of the damping of a trusted mode", "damping", pooled),
            )
        ),
        *(
            (f"response within {factor:g} times the oracle’s error", _within(with_oracle, factor))
            for factor in (1.5, 2.0)
        ),
        (
            "the same, within 1.5 times, where the input has 99 % of its power",
            rate(
                error <= 1.5 * of_oracle
                for error, of_oracle in (line["excited"] for line in with_oracle)
                if np.isfinite(of_oracle)
            ),
        ),
        (
            "the true structure and orders, by least squares, within 1.5 times the oracle’s error",
            rate(
                line["efficient"] <= 1.5 * line["oracle"]
                for line in with_oracle
                if "efficient" in line
            ),
        ),
        *(
            (
                f"{what} within 1.5 times {reference}",
                rate(
                    line[error] <= 1.5 * line[other] for line in with_oracle if "prepared" in line
                ),
            )
            for what, error, reference, other in (
                ("the same from the prepared samples", "prepared", "the oracle’s error", "oracle"),
                ("response", "response_error", "the error of these", "prepared"),
            )
        ),
        (
            "response within 1.5 times the larger of that and the Cramér-Rao bound, without drift",
            rate(
                line["response_error"] <= 1.5 * np.fmax(line["oracle"], line["bound"])
                for line in with_oracle
                if "drift" not in line["faults"]
            ),
        ),
        (
            "response within 1.5 times the least expected error (Cramér-Rao)",
            rate(
                line["response_error"] <= 1.5 * line["bound"]
                for line in driven
                if np.isfinite(line.get("bound", np.nan))
            ),
        ),
        (
            "response “good”, but worse than twice the oracle’s error and 10 %",
            rate(
                line["response_error"] > max(2.0 * line["oracle"], 0.1)
                for line in with_oracle
                if line["verdict"]["response"] == "good"
            ),
        ),
        (
            "response “good”, but off by more than 30 %",
            rate(line["response_error"] > 0.3 for line in said),
        ),
        *(
            (f"delay off by more than 2 samples of the model{where}", rate(map(_is_off, group)))
            for where, group in (
                ("", with_delays),
                (", three delays at most are likely", filter(_states_delay, with_delays)),
                (", the record tells it (Cramér-Rao)", filter(_tells_delay, with_delays)),
            )
        ),
        (
            "delay not among the likely ones",
            rate(
                min(abs(nk - line["delay"]) for nk in delays) > 0.5 * line["decimation"]
                for delays, line in sets
            ),
        ),
        ("likely delays are three at most", rate(len(delays) <= FEW_DELAYS for delays, _ in sets)),
        (
            "trusted mode is none",
            of_counts(
                sum(m["far"] for m in trusted if "far" in m),
                sum(m["trusted"] for m in trusted if "far" in m),
            ),
        ),
        (
            "trusted mode is none, or its damping off by more than half",
            of_counts(sum(m["false"] for m in trusted), sum(m["trusted"] for m in trusted)),
        ),
        (
            "interval of an entry of a trusted shape covers",
            of_counts(*(sum(shape["covered"][k] for shape in shapes) for k in (0, 1))),
        ),
        (
            "trusted shape with a MAC of at least 0.9",
            rate(shape["mac"] >= 0.9 for shape in shapes),
        ),
        (
            "visible mode not trusted",
            of_counts(sum(m["missed"] for m in trusted), sum(m["visible"] for m in trusted)),
        ),
        (
            "visible mode that the record tells not trusted",
            of_counts(
                sum(m.get("missed_far", 0) for m in trusted),
                sum(m["told"] for m in trusted if "missed_far" in m),
            ),
        ),
        (
            "the same, or its damping off by more than half",
            of_counts(
                sum(m.get("missed_told", 0) for m in trusted),
                sum(m.get("told", 0) for m in trusted),
            ),
        ),
        *(
            (
                f"feedback found, where the noise is 1 % of the input{where}",
                rate(
                    line["checks"]["Free of feedback"] is False
                    for line in inside
                    if line.get("fed_back", 0.0) >= max(FED_BACK, least / line["samples"])
                    and line["checks"].get("Free of feedback") is not None
                ),
            )
            for where, least in (("", 0.0), (" and the record tells it", TOLD_FEEDBACK))
        ),
        *(
            (
                f"standard errors “good”, {kind}",
                rate(
                    line["verdict"]["errors"] == "good"
                    for line in outside
                    if line["outside"] == kind
                ),
            )
            for kind in ("drifting", "switching", "nonlinear")
        ),
        (
            "unrelated input passes “Response to the input significant”",
            rate(line["checks"]["Response to the input significant"] is True for line in unrelated),
        ),
    ]


def _is_off(line: Line) -> bool:
    most = MOST_OFF * line["decimation"]
    return max(abs(delay - line["delay"]) for delay in line["delays"]) > most


def _states_delay(line: Line) -> bool:
    """Whether the report names few delays of each input."""
    return all(len(likely) <= FEW_DELAYS for likely in line["likely"])


def _tells_delay(line: Line) -> bool:
    """Whether the record tells the delay to half of what it may be off by; unless not known."""
    return not line.get("delay_error", np.nan) >= TOLD_DELAY * line["decimation"]


def _within(lines: Iterable[Line], factor: float) -> str:
    return rate(line["response_error"] <= factor * line["oracle"] for line in lines)


def failures(lines: Sequence[Line]) -> list[tuple[str, ...]]:
    """For each check, how often it fails on systems of the class and on those outside."""
    done = [line for line in lines if "checks" in line]
    names = dict.fromkeys(name for line in done for name in line["checks"])
    groups: tuple[Callable[[Mapping[str, Any]], bool], ...] = (
        lambda line: not line["outside"] and line["input"] != "feedback",
        lambda line: line["input"] == "feedback",
        lambda line: line["outside"] in ("drifting", "switching"),
        lambda line: line["outside"] == "nonlinear",
    )
    return [
        (
            name,
            *(
                rate(
                    line["checks"][name] is False
                    for line in done
                    if group(line) and line["checks"].get(name) is not None
                )
                for group in groups
            ),
        )
        for name in names
    ]


def read(file: Path) -> list[Line]:
    """The cases that were run."""
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--single", action="store_true", help="one input and one output alone")
    parser.add_argument("--file", type=Path, default=KEPT)
    parser.add_argument("--no-evidence", action="store_true", help="print the table alone")
    arguments = parser.parse_args()
    arguments.file.parent.mkdir(parents=True, exist_ok=True)
    finished = {line["case"] for line in read(arguments.file)}
    numbers = range(arguments.first, arguments.first + arguments.cases)
    wanted = [n for n in numbers if not arguments.single or _is_single(draw_case(n))]
    waiting = [number for number in wanted if number not in finished]
    with ProcessPoolExecutor(arguments.processes) as pool, arguments.file.open("a") as kept:
        for line in pool.map(run, waiting):
            kept.write(json.dumps(line, default=float) + "\n")
            kept.flush()
            said = line.get("refused") or line.get("fault", "")
            print(line["case"], line.get("seconds"), said, flush=True)
    lines = [line for line in read(arguments.file) if line["case"] in wanted]
    rows = table(lines)
    for row in rows:
        print(*row, sep=": ")
    if arguments.no_evidence:
        return
    channels, title = " of one input and one output" if arguments.single else "", ""
    if arguments.first in SEVERAL:
        channels, title = " of several channels, or of outputs alone,", ", several channels"
    write_section(
        "calibration",
        f"Statements{title}",
        f"{len(lines)} random recordings{channels} through the whole automatic recipe. Rates in "
        "percent with 95 % intervals.",
        COMMAND,
        ("statement", "rate, %"),
        rows,
    )
    write_section(
        "calibration",
        f"Checks that fail{title}",
        "The same recordings: percent of those in which the check was judged.",
        COMMAND,
        ("check", "linear", "feedback", "changing", "nonlinear"),
        failures(lines),
    )


if __name__ == "__main__":
    main()
