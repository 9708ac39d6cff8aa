"""Compare rules for the choice among state-space models on synthetic records of several kinds.

    python benchmarks/state_space_choice.py search FOLDER [--records 6] [--kinds ...]
    PYTHON_WITH_SIPPY benchmarks/state_space_choice.py sippy FOLDER
    python benchmarks/state_space_choice.py table FOLDER
    python benchmarks/state_space_choice.py search FOLDER --kinds steady [--records 4]
    python benchmarks/state_space_choice.py drift FOLDER

``search`` runs the delays and the searches of the workflow on each record, and simulates the
samples after it by every candidate.  ``table`` applies the rules to what was found.  The records
are draws of random plants; nothing was set by looking at one of them.  ``drift`` tells how often
the form with a drift is chosen, and what that changes, on records of ``steady`` kinds, whose
outputs have none, and of ``slow`` kinds, whose outputs have one.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import loadmat, savemat
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

# Fresh samples, and the largest order searched: no truth has more than 12 states, and those of the
# steady and slow kinds have 6 at most.
FRESH, MOST, MOST_OF_SHAPES = 1000, 12, 6


@dataclass(frozen=True)
class Plant:
    """``x+ = A x + B u + w, y = C x``; ``bent`` makes the inputs saturate and the gains drift."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    bent: bool = False

    def respond(self, u: np.ndarray, w: np.ndarray | None = None) -> np.ndarray:
        x, y = np.zeros(len(self.A)), np.empty((len(u), len(self.C)))
        if self.bent:
            slow = 1.0 + 0.2 * np.sin(2 * np.pi * np.arange(len(u)) / 700)[:, None]
            u = np.tanh(0.8 * u) * slow
        for t in range(len(u)):
            y[t] = self.C @ x
            x = self.A @ x + self.B @ u[t]
            if w is not None:
                x += w[t]
        return y


def slow_plant(g: np.random.Generator, nu: int, ny: int, n: int, bent: bool = False) -> Plant:
    """Real poles with time constants of 3 to 100 samples, each seen by some of the channels."""
    poles = np.exp(-1.0 / np.exp(g.uniform(np.log(3.0), np.log(100.0), n)))
    B = g.standard_normal((n, nu)) * (1.0 - poles[:, None])
    C = g.standard_normal((ny, n)) * (g.random((ny, n)) < 0.7)
    C[np.arange(ny), np.arange(ny) % n] = 1.0
    return Plant(np.diag(poles), B, C, bent)


def light_plant(g: np.random.Generator, nu: int, ny: int, n: int) -> Plant:
    """Modes with damping of 0.5 to 3 % spread over frequencies up to 0.8 of Nyquist's."""
    modes = n // 2
    A = np.zeros((n, n))
    for k in range(modes):
        angle = np.pi * (0.04 + 0.76 * (k + 0.8 * g.random()) / modes)
        pole = np.exp((-np.exp(g.uniform(np.log(0.005), np.log(0.03))) + 1j) * angle)
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    return Plant(A, g.standard_normal((n, nu)), g.standard_normal((ny, n)))


def held(g: np.random.Generator, samples: int, channels: int, longest: int) -> np.ndarray:
    """Random levels, each held for up to ``longest`` samples."""
    columns = []
    for _ in range(channels):
        lengths = g.integers(1, longest + 1, samples)
        columns.append(np.repeat(g.standard_normal(samples), lengths)[:samples])
    return np.column_stack(columns)


def coloured(g: np.random.Generator, samples: int, channels: int, pole: float) -> np.ndarray:
    e = lfilter([1.0], [1.0, -pole], g.standard_normal((samples + 200, channels)), axis=0)[200:]
    return e / e.std(axis=0)


def drifting(g: np.random.Generator, samples: int, channels: int) -> np.ndarray:
    walk = np.cumsum(g.standard_normal((samples, channels)), axis=0)
    return walk / walk.std(axis=0)


def wandering(g: np.random.Generator, samples: int, channels: int) -> np.ndarray:
    """A random walk without its fast part."""
    walk = lfilter([0.01], [1.0, -0.99], drifting(g, samples, channels), axis=0)
    return walk / walk.std(axis=0)


SHAPES = {"2x2": (2, 2), "3x2": (3, 2), "1x4": (1, 4)}
STEADY = tuple(f"{noise} {shape}" for noise in ("white", "coloured", "driven") for shape in SHAPES)
SLOW = tuple(f"{drift} {shape}" for drift in ("walk", "ramp", "sine") for shape in SHAPES)


def of_shape(
    kind: str, g: np.random.Generator, samples: int, kept: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs, outputs and noise of a plant of order 2 to 6 with slow poles or light damping.

    The noise is white, through poles of 0.7 to 0.97, or drives the states; or it is half white, and
    half a random walk, a ramp, or a sine of one to three periods in the ``kept`` samples.
    """
    form, _, shape = kind.partition(" ")
    nu, ny = SHAPES[shape]
    n = int(g.integers(1, 4)) * 2
    plant = (slow_plant if g.random() < 0.5 else light_plant)(g, nu, ny, n)
    u = held(g, samples, nu, int(g.integers(1, 15)))
    white = g.standard_normal((samples, ny))
    if form == "driven":
        w = 0.5 * g.standard_normal((samples, n)) * np.abs(plant.B).max(axis=1)
        noise = plant.respond(np.zeros_like(u), w)
        return u, plant.respond(u), noise / noise.std(axis=0) + 0.3 * white
    if form == "coloured":
        white = coloured(g, samples, ny, g.uniform(0.7, 0.97))
    times = np.arange(samples)[:, None] / kept
    slow = {
        "white": lambda: np.zeros((samples, ny)),
        "coloured": lambda: np.zeros((samples, ny)),
        "walk": lambda: drifting(g, samples, ny),
        "ramp": lambda: times * g.choice([-1.0, 1.0], ny),
        "sine": lambda: np.sin(2 * np.pi * (times * g.uniform(1.0, 3.0, ny) + g.random(ny))),
    }[form]()
    spread = slow[:kept].std(axis=0)
    return u, plant.respond(u), white + slow / np.where(spread > 0.0, spread, 1.0)


def record(kind: str, seed: int) -> dict[str, np.ndarray]:
    """Inputs, noisy outputs and the outputs without noise, the last ``FRESH`` samples fresh."""
    g = np.random.default_rng(np.random.SeedSequence([seed, zlib.crc32(kind.encode())]))
    n = int(g.integers(4, 13))
    share = g.uniform(0.1, 0.5)
    kept = 160 if kind == "few" else 500
    samples = kept + FRESH
    if kind in ("process", "furnace", "bent"):
        nu, ny = {"process": (3, 3), "furnace": (3, 6), "bent": (2, 2)}[kind]
        plant = slow_plant(g, nu, ny, n, kind == "bent")
        u = held(g, samples, nu, 40)
        w = None
        clean = plant.respond(u)
        noise = coloured(g, samples, ny, g.uniform(0.7, 0.97))
        noise += 0.5 * drifting(g, samples, ny) + 0.3 * g.standard_normal((samples, ny))
    elif kind == "drift":
        # The levels of the outputs wander.
        nu, ny = 2, 3
        plant = slow_plant(g, nu, ny, n)
        u = held(g, samples, nu, 20)
        clean = plant.respond(u)
        noise = wandering(g, samples, ny) + 0.3 * g.standard_normal((samples, ny))
    elif kind == "integrated":
        # The disturbances are integrated noise, and so is a part of one input.
        nu, ny = 3, 2
        plant = slow_plant(g, nu, ny, n)
        u = held(g, samples, nu, 20)
        u[:, :1] += drifting(g, samples, 1)
        clean = plant.respond(u)
        noise = np.cumsum(coloured(g, samples, ny, g.uniform(0.0, 0.8)), axis=0)
    elif kind == "light":
        nu, ny = 2, 8
        plant = light_plant(g, nu, ny, 2 * (n // 2))
        u = g.standard_normal((samples, nu))
        clean = plant.respond(u)
        noise = g.standard_normal((samples, ny))
    elif kind == "few":
        nu, ny = 5, 3
        n = int(g.integers(3, 7))
        plant = slow_plant(g, nu, ny, n)
        u = held(g, samples, nu, 8)
        clean = plant.respond(u)
        noise = coloured(g, samples, ny, g.uniform(0.0, 0.8))
    elif kind == "states":
        # The noise drives the states: one white process through lightly damped modes.
        nu, ny = 2, 2
        plant = light_plant(g, nu, ny, 2 * (n // 2))
        u = g.standard_normal((samples, nu))
        clean = plant.respond(u)
        w = plant.B @ g.standard_normal((nu, samples)) + 0.5 * g.standard_normal(
            (len(plant.A), samples)
        )
        noise = plant.respond(np.zeros_like(u), w.T) + 0.3 * g.standard_normal((samples, ny))
    else:
        u, clean, noise = of_shape(kind, g, samples, kept)
    noise = noise / noise.std(axis=0) * share * clean.std(axis=0)
    return {"u": u, "y": clean + noise, "clean": clean, "kept": kept, "share": share, "order": n}


KINDS = ("process", "furnace", "light", "few", "states", "bent", "drift", "integrated")


def recording_of(u: np.ndarray, y: np.ndarray):  # type: ignore[no-untyped-def]
    from evopem.signals.recording import Recording

    nu, ny = u.shape[1], y.shape[1]
    names = tuple(f"u{k}" for k in range(nu)), tuple(f"y{k}" for k in range(ny))
    return Recording(u, y, 1.0, *names, ("",) * nu, ("",) * ny)


def run_search(folder: Path, count: int, kinds: tuple[str, ...]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    made = {f"{kind}_{seed}": record(kind, seed) for seed in range(count) for kind in kinds}
    for name, each in made.items():
        savemat(folder / f"record_{name}.mat", each)
    for name, each in made.items():
        search_record(folder, name, each)


def search_record(folder: Path, name: str, made: dict[str, np.ndarray]) -> None:
    """Keep the searches of a record, and the errors of every candidate on its fresh samples."""
    from evopem.files.json_form import to_json

    target = folder / f"search_{name}.json"
    if target.exists():
        return
    from evopem.automatic.searched_forms import search_variant
    from evopem.automatic.searched_orders import searched_orders
    from evopem.automatic.variant_search import Variant

    from evopem.config.structures import VARIANTS
    from evopem.estimation.delays import estimate_delays
    from evopem.estimation.state_space.task import QUADRATIC
    from evopem.validation.multichannel import mean_errors

    begun = time.process_time()
    kept = int(np.squeeze(made["kept"]))
    middle_u, middle_y = made["u"][:kept].mean(axis=0), made["y"][:kept].mean(axis=0)
    whole = recording_of(made["u"] - middle_u, made["y"] - middle_y)
    estimation, fresh = whole.between(0, kept), whole.between(kept, whole.samples)
    noiseless = recording_of(made["u"] - middle_u, made["clean"] - middle_y)
    noiseless = noiseless.between(kept, whole.samples)
    delays = estimate_delays(estimation)
    most = MOST_OF_SHAPES if name.partition("_")[0] in (*STEADY, *SLOW) else MOST
    orders = [each for each in searched_orders(estimation, None) if each <= most]
    searches, errors = [], {}
    for variant in (Variant(*each) for each in VARIANTS):
        found, models = search_variant(estimation, variant, delays, orders, QUADRATIC)
        searches.append(to_json(found))
        for order in found.orders:
            model = models.of_order(order)
            errors[f"{variant.name} {order}"] = {
                "measured": mean_errors(model, fresh, False)[1],
                "level": mean_errors(model, fresh, True)[1],
                "clean": mean_errors(model, noiseless, True)[1],
                "states": model.order,
            }
    seconds = time.process_time() - begun
    content = {"searches": searches, "errors": errors, "delays": delays, "seconds": seconds}
    target.write_text(json.dumps(content))
    print(f"{name}: {seconds:.0f} s, {len(errors)} candidates", flush=True)


def run_sippy(folder: Path) -> None:
    """N4SID and MOESP of the order of the lowest BIC, with horizons of 20 samples."""
    from sippy_unipi import system_identification

    for file in sorted(folder.glob("record_*.mat")):
        made = loadmat(file)
        kept = int(made["kept"][0, 0])
        u, y = made["u"][:kept], made["y"][:kept]
        u, y = u - u.mean(axis=0), y - y.mean(axis=0)
        horizon = min(20, kept // (2 * (u.shape[1] + y.shape[1])))
        for method in ("N4SID", "MOESP"):
            target = file.with_name(file.name.replace("record", f"sippy {method}"))
            if target.exists():
                continue
            try:
                found = system_identification(
                    *(y.T, u.T, method),
                    IC="BIC",
                    SS_orders=[1, min(20, horizon)],
                    SS_f=horizon,
                    SS_p=horizon,
                    SS_D_required=True,
                )
            except Exception as error:
                print(f"{target.name}: {error}")
                continue
            savemat(target, {name: getattr(found, name) for name in "ABCD"})


def peer_errors(folder: Path, name: str, free_level: bool) -> dict[str, float]:
    """Errors of the peers on the fresh samples, with the level that the candidates have there."""
    from evopem.models.state_space import StateSpaceModel
    from evopem.validation.multichannel import mean_errors

    made = loadmat(folder / f"record_{name}.mat")
    kept = int(made["kept"][0, 0])
    u, y = (made[key] - made[key][:kept].mean(axis=0) for key in "uy")
    fresh = recording_of(u, y).between(kept, len(y))
    errors = {}
    for method in ("N4SID", "MOESP"):
        file = folder / f"sippy {method}_{name}.mat"
        errors[method] = np.inf
        if not file.exists():
            continue
        found = loadmat(file)
        ny = fresh.outputs.shape[1]
        if np.abs(np.linalg.eigvals(found["A"])).max() >= 1.0:
            continue
        model = StateSpaceModel(
            **{key: found[key] for key in "ABCD"},
            K=np.zeros((len(found["A"]), ny)),
            sampling_rate=1.0,
            level=np.zeros(ny),
            noise_covariance=np.eye(ny),
        )
        errors[method] = mean_errors(model, fresh, free_level)[1]
    return errors


@dataclass(frozen=True)
class Scored:
    """A candidate with what the rules may use, and its error on fresh samples."""

    form: str
    order: int
    score: float
    of_folds: np.ndarray
    bic: float
    parameters: int
    fresh: float
    clean: float


def scored_candidates(content: dict, made: dict) -> tuple[list[Scored], str]:  # type: ignore[type-arg]
    """All candidates of a record, and whether simulations fit a level to other samples."""
    from evopem.automatic.state_space_choice import CLEAR_GAIN, scores_of
    from evopem.automatic.variant_search import VariantSearch

    from evopem.automatic.level_decision import decide_level
    from evopem.files.json_form import from_json

    searches = [from_json(VariantSearch, each) for each in content["searches"]]
    searches = [each for each in searches if each.orders]
    lowest = [
        float(np.nanmin(np.concatenate([getattr(each, kind) for each in searches])))
        for kind in ("simulation", "free_level")
    ]
    level, _ = decide_level(*lowest, CLEAR_GAIN)
    kind = scores_of("simulation", level)
    signals = made["u"].shape[1] + made["y"].shape[1]
    found = []
    for search in searches:
        for place, order in enumerate(search.orders):
            score = getattr(search, kind)[place]
            errors = content["errors"][f"{search.variant.name} {order}"]
            found.append(
                Scored(
                    search.variant.form,
                    order,
                    score if np.isfinite(score) else np.inf,
                    np.array([getattr(fold, kind)[place] for fold in search.folds]),
                    search.coloured_bic[place],
                    errors["states"] * signals,
                    errors["level" if level == "state" else "measured"],
                    errors["clean"],
                )
            )
    return found, level


def near(candidates: list[Scored], margin: float, deviations: float = 1.0) -> list[Scored]:
    """Those whose error is within a share of the lowest, or within standard errors of it."""
    best = min(candidates, key=lambda each: each.score)

    def as_good(each: Scored) -> bool:
        if each.score <= (1.0 + margin) * best.score:
            return True
        if len(best.of_folds) < 3 or not np.isfinite(each.score):
            return False
        ratios = np.log(each.of_folds / best.of_folds)
        error = np.std(ratios, ddof=1) / np.sqrt(len(ratios))
        return bool(np.log(each.score / best.score) <= deviations * error)

    return [each for each in candidates if as_good(each)]


def mean_over_folds(each: Scored) -> float:
    """Geometric mean: a single fold in which a simulation drifts counts less than in the sum."""
    return float(np.exp(np.log(each.of_folds).mean()))


def lowest_ranks(candidates: list[Scored]) -> Scored:
    errors = np.array([each.of_folds for each in candidates])
    ranks = errors.argsort(axis=0).argsort(axis=0).mean(axis=1)
    return candidates[int(np.argmin(ranks))]


def lowest(candidates: list[Scored], by: str) -> Scored:
    keys: dict[str, Callable[[Scored], tuple[float, ...]]] = {
        "error": lambda each: (each.score,),
        "mean": lambda each: (mean_over_folds(each),),
        "bic": lambda each: (each.bic,),
        "parameters": lambda each: (each.parameters, each.score),
    }
    return min(candidates, key=keys[by])


def within_form(candidates: list[Scored], margin: float) -> Scored:
    """The most likely order of the form whose error is lowest: the rule of the workflow."""
    form = min(candidates, key=lambda each: each.score).form
    return lowest([each for each in near(candidates, margin) if each.form == form], "bic")


def without_drift(candidates: list[Scored]) -> list[Scored]:
    """All but the output-error models with a drift."""
    return [each for each in candidates if each.form != "ss_oe_drift"]


RULES: dict[str, Callable[[list[Scored]], Scored]] = {
    "lowest held-out error": lambda c: lowest(c, "error"),
    "lowest geometric mean over folds": lambda c: lowest(c, "mean"),
    "lowest mean rank over folds": lowest_ranks,
    "likelihood of all": lambda c: lowest(c, "bic"),
    "2 %, likelihood": lambda c: lowest(near(c, 0.02, 0.0), "bic"),
    "5 %, likelihood": lambda c: lowest(near(c, 0.05, 0.0), "bic"),
    "10 %, likelihood": lambda c: lowest(near(c, 0.1, 0.0), "bic"),
    "25 %, likelihood": lambda c: lowest(near(c, 0.25, 0.0), "bic"),
    "one standard error, likelihood": lambda c: lowest(near(c, 0.05), "bic"),
    "the same without drift (as before)": lambda c: lowest(near(without_drift(c), 0.05), "bic"),
    "one standard error, likelihood within best form (as now)": lambda c: within_form(c, 0.05),
    "one standard error, lowest geometric mean": lambda c: lowest(near(c, 0.05), "mean"),
    "one standard error, fewest parameters": lambda c: lowest(near(c, 0.05), "parameters"),
    "5 %, fewest parameters": lambda c: lowest(near(c, 0.05, 0.0), "parameters"),
}


def print_table(folder: Path) -> None:
    """Geometric means of the errors on fresh samples, over those of the best candidate."""
    rows: dict[str, dict[str, list[float]]] = {}
    kinds: list[str] = []
    for file in sorted(folder.glob("search_*.json")):
        name = file.stem.removeprefix("search_")
        kind = name.rpartition("_")[0]
        kinds += [kind] if kind not in kinds else []
        made = loadmat(folder / f"record_{name}.mat")
        candidates, level = scored_candidates(json.loads(file.read_text()), made)
        best = min(each.fresh for each in candidates)
        for rule, choose in RULES.items():
            rows.setdefault(rule, {}).setdefault(kind, []).append(choose(candidates).fresh / best)
        for method, error in peer_errors(folder, name, level == "state").items():
            rows.setdefault(f"SIPPY {method}", {}).setdefault(kind, []).append(error / best)
    print("| rule | " + " | ".join(kinds) + " | all | worst |")
    print("|---" * (len(kinds) + 3) + "|")
    for rule, found in rows.items():
        each = [found[kind] for kind in kinds]
        every = np.concatenate(each)
        cells = [_mean(np.array(values)) for values in (*each, every)]
        print(f"| {rule} | " + " | ".join(cells) + f" | {np.max(every, initial=1.0):.2f} |")


def print_drifts(folder: Path) -> None:
    """How often a drift is chosen, and the errors of the choice over those without that form."""
    rows: dict[str, list[tuple[bool, float, float, float]]] = {}
    for file in sorted(folder.glob("search_*.json")):
        kind = file.stem.removeprefix("search_").rpartition("_")[0]
        if kind not in (*STEADY, *SLOW):
            continue
        row = drift_row(json.loads(file.read_text()))
        for name in (kind.split()[0], "steady" if kind in STEADY else "slow"):
            rows.setdefault(name, []).append(row)
    print(
        "| noise | records | drift chosen | error with it / without it | worst | all records "
        "| choice / best other in hindsight |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, found in rows.items():
        chosen, with_it, of_all, of_best = (
            np.array([row[place] for row in found]) for place in range(4)
        )
        taken = with_it[chosen]
        print(
            f"| {name} | {len(found)} | {chosen.sum()} | {_mean(taken)} | "
            f"{np.max(taken, initial=0.0):.2f} | {_mean(of_all)} | {_mean(of_best)} |"
        )


def drift_row(content: dict) -> tuple[bool, float, float, float]:  # type: ignore[type-arg]
    """Whether the drift is chosen, and the errors of the choice against the noise-free outputs.

    Over those of the choice without that form, twice, and of the best other candidate.
    """
    from evopem.automatic.state_space_choice import choose
    from evopem.automatic.variant_search import VariantSearch

    from evopem.config.settings import AutomaticSettings
    from evopem.files.json_form import from_json

    searches = [from_json(VariantSearch, each) for each in content["searches"]]
    others = [each for each in searches if each.variant.form != "ss_oe_drift"]
    own, other = (
        choose(each, AutomaticSettings(purpose="simulation")).model for each in (searches, others)
    )
    errors = {name: each["clean"] for name, each in content["errors"].items()}
    error, without = (errors[f"{each.variant.name} {each.order}"] for each in (own, other))
    best = min(value for name, value in errors.items() if "drift" not in name)
    chosen = own.variant.form == "ss_oe_drift"
    return chosen, error / without, error / without, error / best


def _mean(ratios: np.ndarray) -> str:
    """Geometric mean of the finite ones; how many are not."""
    finite = ratios[np.isfinite(ratios)]
    lost = len(ratios) - len(finite)
    mean = f"{np.exp(np.log(finite).mean()):.3f}" if len(finite) else "-"
    return mean + (f" ({lost} unstable)" if lost else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("search", "sippy", "table", "drift"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--records", type=int, default=6)
    parser.add_argument("--kinds", nargs="*", default=KINDS)
    arguments = parser.parse_args()
    families = {"steady": STEADY, "slow": SLOW}
    kinds = tuple(kind for name in arguments.kinds for kind in families.get(name, (name,)))
    parts: dict[str, Callable[[], None]] = {
        "search": lambda: run_search(arguments.folder, arguments.records, kinds),
        "sippy": lambda: run_sippy(arguments.folder),
        "table": lambda: print_table(arguments.folder),
        "drift": lambda: print_drifts(arguments.folder),
    }
    parts[arguments.part]()


if __name__ == "__main__":
    main()
