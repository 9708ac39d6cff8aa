"""What `evopem FILE` takes from a hundred files in the style of loggers, without other arguments.

    PYTHONPATH=workflow/scripts python benchmarks/hundred_files.py

Each file holds input and output of a resonance, in a form that loggers write. Right:
the channels and the rate are those that were written. Refused: a sentence says what is missing,
which is just where neither names nor times tell it. The last column says which of both was due.
"""

import tempfile
from collections import Counter
from functools import partial
from itertools import starmap
from pathlib import Path

import numpy as np
import pandas as pd
import scipy.io
from scipy.signal import lfilter

from evopem.config.defaults import complete
from evopem.errors import InputError
from evopem.signals.reading import read_measured
from evopem.terminal.new_configuration import certain_channels

SAMPLES = 900
RNG = np.random.default_rng(1)
U = lfilter([1.0], [1.0, -0.5], RNG.standard_normal(SAMPLES))
Y = lfilter([0.0, 0.4, 0.3], [1.0, -1.5, 0.9], U) + 0.05 * RNG.standard_normal(SAMPLES)
# Names that tell input and output, names in another language, and none that tells.
NAMES = (("u", "y"), ("Force [N]", "Acc tip Z [m/s²]"), ("Kraft [N]", "Weg [mm]"), ("a", "b"))
SHARED = Path(__file__).parents[2] / "shared" / "data"


def text(columns, separator=",", mark=".", header=True, digits=9, end="\n", before=""):
    """A table of named columns; numbers with a decimal mark, anything else as it is."""
    lines = [separator.join(columns)] if header else []
    for row in zip(*columns.values(), strict=True):
        cells = [c if isinstance(c, str) else f"{c:.{digits}g}".replace(".", mark) for c in row]
        lines.append(separator.join(cells))
    return before + end.join(lines) + end


def styles(names, rate):
    """File name, content and whether the file tells its rate, of each style of table."""
    t = np.arange(SAMPLES) / rate
    u, y = names
    both = {u: U, y: Y} if rate in (100.0, 250.0) else {y: Y, u: U}
    stamps = pd.Timestamp("2026-03-01 08:15:00") + pd.to_timedelta(t, unit="s")
    yield "comma.csv", text({"time": t} | both), True
    yield "semicolon.csv", text({"Zeit [s]": t} | both, ";", ","), True
    yield "tab.txt", text({"t": t} | both, "\t"), True
    yield "tab_comma.txt", text({"Time (s)": t} | both, "\t", ","), True
    yield (
        "spaces.dat",
        text({"time": t} | {n.replace(" ", "_"): v for n, v in both.items()}, " "),
        True,
    )
    yield "crlf.csv", text({"time_s": t} | both, end="\r\n"), True
    yield "bom.csv", "\ufeff" + text({"time": t} | both), True
    yield "quoted.csv", text({'"time"': t} | {f'"{n}"': v for n, v in both.items()}), True
    yield "excel.csv", text({"time": t} | both, ";", ",", before="sep=;\n"), True
    yield "comments.csv", text({"time": t} | both, before="# logger 7\n# 2026-03-01\n"), True
    yield "percent.txt", text({"time": t} | both, "\t", before="% made by hand\n"), True
    yield (
        "title.csv",
        text({"time": t} | both, before="Test 12, bench 3\nOperator: N. N.\n\n"),
        True,
    )
    yield "units.csv", text({"time": ["s", *t], u: ["N", *U], y: ["mm", *Y]}), True
    yield "milliseconds.csv", text({"time [ms]": 1000 * t} | both), True
    yield "whole_ms.csv", text({"time_ms": np.round(1000 * t).astype(int)} | both, digits=12), True
    yield (
        "iso.csv",
        text({"timestamp": stamps.strftime("%Y-%m-%dT%H:%M:%S.%f").tolist()} | both),
        True,
    )
    yield "iso_zone.csv", text({"time": [f"{s.isoformat()}+00:00" for s in stamps]} | both), True
    yield "clock.csv", text({"time": stamps.strftime("%H:%M:%S.%f").tolist()} | both), True
    yield (
        "german_date.csv",
        text({"Zeit": stamps.strftime("%d.%m.%Y %H:%M:%S.%f").tolist()} | both, ";", ","),
        True,
    )
    yield "epoch.csv", text({"timestamp": 1.7724e9 + t} | both, digits=16), True
    yield "exponents.csv", text({"time": t} | both, digits=5), True
    yield "trailing.csv", text({"time": t} | both | {"": [""] * SAMPLES}), True
    yield "index.csv", text({"": np.arange(SAMPLES), "time": t} | both, digits=10), True
    yield "last.csv", text(both | {"time": t}), True
    yield (
        "gaps.csv",
        text({"time": t, u: ["NaN" if k == 400 else v for k, v in enumerate(U)], y: Y}),
        True,
    )
    yield "no_time.csv", text(both), False
    yield "no_header.csv", text({"": t} | {" ": U, "  ": Y}, header=False), True
    yield (
        "lvm.lvm",
        text(
            {"X_Value": t} | both,
            "\t",
            before="LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n\n",
        ),
        True,
    )
    yield (
        "lvm.txt",
        text(
            {"X_Value": t} | both,
            "\t",
            before="LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n\n",
        ),
        True,
    )


def uff(rate, name, values):
    """A dataset 58: double precision, even abscissa."""
    none = f"{'NONE':<20} {'NONE':<20}"
    head = [
        *(
            "    -1",
            "    58",
            *(each.ljust(80) for each in (name, "NONE", "01-MAR-26", "NONE", "NONE")),
        ),
        f"{1:5d}{1:10d}{0:5d}{0:10d} {'NONE':>10}{12:10d}{3:4d} {'NONE':>10}{0:10d}{0:4d}",
        f"{4:10d}{values.size:10d}{1:10d}{0.0:13.5e}{1.0 / rate:13.5e}{0.0:13.5e}",
        f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':<20} {'s':<20}",
        *(f"{kind:10d}{0:5d}{0:5d}{0:5d} {none}" for kind in (0, 0, 0)),
    ]
    rows = (values[k : k + 4] for k in range(0, values.size, 4))
    body = ["".join(f"{value:20.11e}" for value in row) for row in rows]
    return "\n".join([*head, *body, "    -1", ""])


def binaries(folder, names, rate):
    """Files of binary formats."""
    t = np.arange(SAMPLES) / rate
    u, y = names
    plain = {"".join(filter(str.isalnum, n)) or "x": v for n, v in zip(names, (U, Y), strict=True)}
    scipy.io.savemat(folder / "time.mat", {"t": t} | plain)
    yield "time.mat", True
    scipy.io.savemat(folder / "rate.mat", {"fs": rate} | plain)
    yield "rate.mat", True
    scipy.io.savemat(folder / "nothing.mat", plain)
    yield "nothing.mat", False
    np.savez(folder / "time.npz", time=t, **plain)
    yield "time.npz", True
    np.save(folder / "table.npy", np.column_stack([t, U, Y]))
    yield "table.npy", True
    frame = pd.DataFrame({"time": t, u: U, y: Y})
    frame.to_parquet(folder / "frame.parquet")
    yield "frame.parquet", True
    frame["time"] = pd.Timestamp("2026-03-01") + pd.to_timedelta(t, unit="s")
    frame.set_index("time").to_parquet(folder / "index.parquet")
    yield "index.parquet", True
    import h5py

    with h5py.File(folder / "log.h5", "w") as file:
        for name, values in ({"time": t} | plain).items():
            file[f"run/{name}"] = values
    yield "log.h5", True
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(folder / "log.tdms") as writer:
        writer.write_segment(
            [
                ChannelObject(
                    "bench", name, values, {"wf_increment": 1 / rate, "wf_samples": SAMPLES}
                )
                for name, values in zip(names, (U, Y), strict=True)
            ]
        )
    yield "log.tdms", True
    (folder / "log.uff").write_text(
        "".join(starmap(partial(uff, rate), zip(names, (U, Y), strict=True)))
    )
    yield "log.uff", True
    from scipy.io import wavfile

    wavfile.write(folder / "log.wav", int(rate), np.column_stack([U, Y]).astype(np.float32))
    yield "log.wav", True


def several(rate):
    """Files of more than two signals: content, inputs and outputs that are due; None to refuse."""
    t = np.arange(SAMPLES) / rate
    more = {f"acc_{k}": lfilter([1.0, 0.2 * k], [1.0], Y) for k in range(1, 4)}
    yield "hammer.csv", {"time": t, "force": U} | more, (["force"], [*more])
    yield (
        "two_forces.csv",
        {"t": t, "u1": U, "u2": U[::-1], "y1": Y, "y2": Y**2},
        (["u1", "u2"], ["y1", "y2"]),
    )
    yield "outputs.csv", {"time": t} | more, None
    yield "channels.csv", {"time": t, "CH1": U, "CH2": Y, "CH3": Y[::-1]}, None
    yield "single.csv", {"time": t, "y": Y}, None
    yield "dead.csv", {"time": t, "u": np.full(SAMPLES, 2.0), "y": Y}, None
    yield "status.csv", {"time": t, "u": U, "y": Y, "status": ["ok"] * SAMPLES}, (["u"], ["y"])


def judged(path, due, rate):
    """What was taken from a file, and whether that is right, refused or wrong."""
    try:
        keys, _ = certain_channels(str(path))
        given = {"file": str(path)} | {
            key: value for key, value in keys.items() if value is not None
        }
        given = {k: v[0] if isinstance(v, list) and len(v) == 1 else v for k, v in given.items()}
        settings = complete({"datasets": {"x": given}}).datasets["x"]
        recording = read_measured(path, settings.source.channels)[0]
    except InputError as error:
        return "refused", f"{error.problem}"
    taken = [list(recording.input_names), list(recording.output_names)]
    same = due is None or [*map(len, due)] == [*map(len, taken)]
    inputs = np.asarray(recording.inputs)[: SAMPLES // 3, 0]
    right = same and np.allclose(inputs, U[: SAMPLES // 3], rtol=1e-3, atol=1e-3)
    right = right and abs(recording.sampling_rate / rate - 1) < 1e-4
    return (
        "right" if right else "WRONG"
    ), f"{taken[0]} → {taken[1]} at {recording.sampling_rate:g} Hz"


def main() -> None:
    counts, rows = Counter(), []
    with tempfile.TemporaryDirectory() as top:
        jobs = []
        for names, rate in zip(NAMES, (100.0, 2048.0, 250.0, 1000.0), strict=True):
            folder = Path(top) / names[0].split()[0]
            folder.mkdir()
            told = names[0] in ("u", "Force [N]")
            for name, content, timed in styles(names, rate):
                (folder / name).write_text(content, encoding="utf-8", newline="")
                jobs.append((folder / name, ([""], [""]), rate, timed and told))
            for name, timed in binaries(folder, names, rate):
                jobs.append((folder / name, ([""], [""]), rate, timed and told))
        for name, columns, due in several(500.0):
            (Path(top) / name).write_text(text(columns))
            jobs.append((Path(top) / name, due, 500.0, due is not None))
        for path, due, rate, certain in jobs:
            try:
                outcome, what = judged(path, due, rate)
            except Exception as error:
                outcome, what = "CRASH", repr(error)
            just = outcome == "right" or (outcome == "refused" and not certain)
            counts[just] += 1
            rows.append((str(path.relative_to(top)), outcome, "" if just else "NOT JUST", what))
        for file in sorted(SHARED.rglob("*.*")) if SHARED.is_dir() else ():
            if file.suffix in (".dat", ".csv", ".mat"):
                outcome, what = judged(file, None, 1.0)
                rows.append((f"measured/{file.name}", outcome.lower(), "", what))
    for row in rows:
        print(*(f"{cell:{width}}" for cell, width in zip(row, (28, 8, 9, 0), strict=True)))
    print(f"{counts[True]} of {counts.total()} generated files right or justly refused")


if __name__ == "__main__":
    main()
