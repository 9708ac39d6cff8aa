"""Units of time, and the names of channels that hold times."""

import re

from evopem.errors import InputError

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""Seconds in each unit of time."""

_SPELLINGS = {
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes segundo segundos",
    "ms": "ms msec msecs msek millis millisec millisecs millisecond milliseconds millisekunden",
    "us": "us µs μs usec usecs µsec μsec micros microsec microsecs microsecond microseconds"
    " mikrosekunden",
    "ns": "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds nanosekunden",
    "min": "min mins minute minutes minuten",
    "h": "h hr hrs hour hours stunde stunden",
    "d": "d day days tag tage",
}
_UNIT_OF = {text: unit for unit, texts in _SPELLINGS.items() for text in texts.split()}

_TIME_WORDS = {
    "t", "time", "times", "zeit", "temps", "tiempo", "tempo", "timestamp", "timestamps", "stamp",
    "stamps", "clock", "elapsed", "uptime", "runtime", "abszeit", "messzeit",
}  # fmt: skip
"""Words that begin the name of a time channel, and after which a unit may follow."""
_OTHER_WORDS = {
    "a", "abs", "absolute", "axis", "b", "base", "channel", "col", "column", "date", "daq", "gps",
    "in", "index", "local", "log", "of", "raw", "rel", "relative", "sample", "sampling", "series",
    "since", "sim", "start", "the", "utc", "value", "values", "vec", "vector", "x", "y", "unix",
    "epoch", "measured", "measurement", "out", "data", "test",
}  # fmt: skip
"""Words in the name of a time channel that are no units."""

_BRACKET = re.compile(r"[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]\s*$")
_CAMEL_CASE = re.compile(r"(?<=[a-z])(?=[A-Z])")
_JOINED = re.compile(r"(?:time|t)(ms|us|µs|ns|msec|usec|nsec|sec|min)")


def seconds_of(unit: str) -> float | None:
    """Seconds in a unit of time as files spell it ("ms", "msec", "Sekunden"); None if unknown."""
    spelled = _spelled(unit)
    return TIME_UNITS[_UNIT_OF[spelled]] if spelled in _UNIT_OF else None


def names_time(name: str) -> bool:
    """Whether the name of a channel holds a word for time."""
    return not _TIME_WORDS.isdisjoint(map(_spelled, _words(name)))


def _spelled(unit: str) -> str:
    """A unit without brackets, final point and the date that it counts from."""
    bare = unit.strip().strip("[](){}<>").strip().rstrip(".").casefold()
    return re.sub(r"\s+since\s.*", "", bare.replace("μ", "µ"))


def stated_unit(name: str, unit: str, source: str, place: str) -> str | None:
    """The unit that the file states for the stamps, as a key of `TIME_UNITS`."""
    written, in_name = _spelled(unit), _unit_in_name(name)
    stated = [text for text in ("" if written == "-" else written, in_name) if text]
    for text in stated:
        if text not in _UNIT_OF:
            remedy = f"set time_unit to one of {', '.join(TIME_UNITS)}"
            raise InputError(source, f'"{text}" is no known unit of time', remedy, place)
    units = {_UNIT_OF[text] for text in stated}
    if len(units) > 1:
        problem = f'the file states the unit "{unit}" for a channel whose name states "{in_name}"'
        raise InputError(source, problem, f"set time_unit to {' or '.join(sorted(units))}", place)
    return units.pop() if units else None


def _words(name: str) -> list[str]:
    return re.split(r"[\s_\-./,:;|\[\](){}<>]+", _CAMEL_CASE.sub(" ", name))


def _unit_in_name(name: str) -> str:
    """What stands for a unit in the name of a time channel, known or not; empty if nothing does. A
    text in brackets at the end; else a last or first word that is a known unit ("time_ms_1"); else
    a last word of letters that follows a word for time ("time_ticks") and is no usual one."""
    bracketed = _BRACKET.search(name)
    if bracketed:
        return _spelled(bracketed.group(1))
    words = [word for word in map(_spelled, _words(name)) if word]
    while len(words) > 1 and (words[-1] in _OTHER_WORDS or words[-1].isdigit()):
        words.pop()
    if not words:
        return ""
    first, last = words[0], words[-1]
    joined = _JOINED.fullmatch(last)
    if joined:
        return joined.group(1)
    for word in (last, first):
        # A single letter may be a name of its own.
        if word in _UNIT_OF and (len(words) > 1 or word == "s" or len(word) > 1):
            return word
    follows = any(word in _TIME_WORDS for word in words[:-1])
    if follows and last.isalpha() and last not in _TIME_WORDS | _OTHER_WORDS:
        return last
    return ""
