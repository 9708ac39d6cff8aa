"""Records of random plants of several kinds: truths that no rule was made with."""

from __future__ import annotations

import sys
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem.signals.recording import Recording  # noqa: E402

# Samples beside those that are kept for the estimate.
FRESH = 1000


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


def recording_of(u: np.ndarray, y: np.ndarray) -> Recording:
    nu, ny = u.shape[1], y.shape[1]
    names = tuple(f"u{k}" for k in range(nu)), tuple(f"y{k}" for k in range(ny))
    return Recording(u, y, 1.0, *names, ("",) * nu, ("",) * ny)
