"""What a column may be, by its name: the signal, and the unit and the sign that the name says."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import yaml

from aircraft_sysid_ros.recordings.tabular.guess.series import SPEEDS
from aircraft_sysid_ros.recordings.tabular.header import split_unit
from aircraft_sysid_ros.recordings.tabular.signals import UNITS
from aircraft_sysid_ros.recordings.tabular.units import dimension_fits, is_unit

TIME = "time"
_VOCABULARY = yaml.safe_load(Path(__file__).with_name("names.yaml").read_text(encoding="utf8"))
#: Signal, sign and place in the list by name.
_BY_NAME = {
    word.lstrip("-"): (signal, -1.0 if word.startswith("-") else 1.0, rank)
    for signal, words in reversed(_VOCABULARY["signals"].items())
    for rank, word in enumerate(words.split())
}
#: Speed or course over ground by name.
_OF_TRACK = {word: part for part, words in _VOCABULARY["ground_track"].items() for word in words.split()}
_SOURCES = frozenset(_VOCABULARY["sources"].split())
_OTHERS = frozenset(_VOCABULARY["others"].split())
_DEMANDS, _ELSEWHERE = (frozenset(_VOCABULARY[key].split()) for key in ("demands", "elsewhere"))
_SIDES = {side: frozenset(words.split()) for side, words in _VOCABULARY["sides"].items()}
#: SI units by the word of a quantity.
_QUANTITIES: dict[str, frozenset[str]] = {
    word: frozenset(unit for unit, words in _VOCABULARY["quantities"].items() if word in words.split())
    for word in " ".join(_VOCABULARY["quantities"].values()).split()
}
#: Of a stick: what has no unit there is of -1 to 1, and no angle.
_INPUTS = frozenset({"actuator", "actuators", "control", "controls", "input", "inputs"})
_OF_ENGINES, _SURFACES = ("throttle", "thrust", "propeller_speed"), ("elevator", "aileron", "rudder", "flaps")
#: Names that mean something else as well: lengths and widths, a capacity, a regime of flight, a quaternion.
_NEEDS_UNIT = frozenset({"laenge", "breite", "cap", "regime", "orientation"})
_COMMANDS = frozenset({"cmd", "command", "commanded"})
_UNIT_ENDINGS, _SAYS_UNIT = (
    {word: unit for unit, words in _VOCABULARY[key].items() for word in words.split()}
    for key in ("unit_endings", "says_unit")
)
_LETTERS = str.maketrans({
    "α": "alpha", "β": "beta", "φ": "phi", "θ": "theta", "ψ": "psi", "ρ": "rho", "δ": "d",
    "ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss", "é": "e", "è": "e", "ê": "e", "à": "a",
})  # fmt: skip
#: A receiver of GPS has a course, which is called a heading, and a speed over ground; neither is what these names say.
_RECEIVERS, _HEADINGS = frozenset({"gps", "gnss"}), frozenset({"heading", "hdg", "head"})
#: What is said of a centre of gravity, and is measured there; else it is its place, the mass in it or a time of it.
_CENTER, _THERE = "cg", ("specific_force", "velocity", "angle_of_attack", "sideslip", *SPEEDS)
#: Three angles of some order: heading, roll and pitch of a sensor by Bosch, azimuth, pitch and roll of a telephone.
_OF_ANY_ORDER = "orientation"
_UNIT_OF_TRACK = {"speed": "m/s", "course": "rad"}
_WRITTEN: dict[str, str] = _VOCABULARY["written"]
_INDEX = re.compile(r"\[(\d)\](?=$|_)")
_UNIT_BEFORE_INDEX = re.compile(r"_([a-z0-9]+)\[(\d)\]$")
_FIELD_OF_ROS = re.compile(r"^field\.|^_\.|^/")


@dataclass(frozen=True)
class NameGuess:
    """What a name says: signal, unit ("" nothing), which way is positive by custom, and how far-fetched it is.

    A sign of 0: nothing is custom, and only a law tells that it is the signal.
    """

    signal: str
    unit: str
    sign: float
    distance: int


def guess_name(column: str, unit: str = "", table: str = "") -> NameGuess | None:
    """The signal of a column by its name and the unit of its header; None for what has no known name."""
    base, unit = _without_brackets(column, unit)
    words = _words(base)
    best: NameGuess | None = None
    for tokens, said, cost in [*_readings(words), *_readings_of_path(base)]:
        found = _BY_NAME.get("_".join(tokens))
        if found is None:
            continue
        signal, sign, rank = found
        speed = _BY_NAME[words[-1]][0] if words[-1] in _SAYS_UNIT else ""
        if speed in SPEEDS:
            if signal not in SPEEDS:
                continue  # vs_kias is where it stalls
            signal = speed  # of airspeed_ktas
        said = unit if is_unit(unit) else said or _SAYS_UNIT.get("_".join(tokens), "")
        if (said and not _fits(said, signal)) or (not said and (is_command(column) or tokens[0] in _NEEDS_UNIT)):
            continue  # a command of -1 to 1 is no angle
        if not _RECEIVERS.isdisjoint(words) and (signal in SPEEDS or not _HEADINGS.isdisjoint(words)):
            continue
        if _CENTER in words and not signal.startswith(_THERE):
            continue
        sign = 0.0 if tokens[0] == _OF_ANY_ORDER else sign
        guess = NameGuess(signal, said, sign, 100 * cost + rank)
        if best is None or guess.distance < best.distance:
            best = guess
    return best


def in_company(column: str, columns: Iterable[str]) -> str:
    """A name as it is meant beside others: in French ``v_est`` beside ``v_nord`` is to the east, and no estimate."""
    words = _words(column)
    if "est" not in words or not any("nord" in _words(other) for other in columns):
        return column
    return "_".join("ost" if word == "est" else word for word in words)


def without_side(column: str) -> tuple[str, str] | None:
    """``left`` or ``right`` and the rest of a name that says one of these; None for others."""
    words = _words(column)
    sides = [(word, side) for side, of in _SIDES.items() for word in words if word in of]
    if len(sides) != 1 or len(words) < 2:
        return None
    (word, side), at = sides[0], words.index(sides[0][0])
    return (side, "_".join(words[:at] + words[at + 1 :])) if words.count(word) == 1 else None


def guess_ground_track(column: str, unit: str = "") -> tuple[str, str] | None:
    """Whether a name says speed or course over ground (``speed``, ``course``), and its unit; None for all others."""
    base, unit = _without_brackets(column, unit)
    variants = _without_unit(_words(base))
    endings = [ending for _, ending in variants if ending]
    if endings and not any(dimension_fits(e, of) for e in endings for of in _UNIT_OF_TRACK.values()):
        return None  # a distance along a track
    for words, ending in variants:
        for tokens in (words, [word for word in words if word not in _SOURCES]):
            part = _OF_TRACK.get("_".join(tokens))
            said = unit if is_unit(unit) else ending
            if part is not None and (not said or dimension_fits(said, _UNIT_OF_TRACK[part])):
                return part, said
    return None


def is_command(column: str) -> bool:
    """Whether a name says that the column is what was asked for, and not what came of it."""
    return not _COMMANDS.isdisjoint(_words(column))


def is_of_another(column: str) -> bool:
    """Whether a name says that the column is no measurement: a demand, an error, a count, …"""
    return _is_of_another(_words(column))


def is_asked_for(table: str) -> bool:
    """Whether the name of a table or of a topic says that its columns are what was asked for."""
    return not _DEMANDS.isdisjoint(_words(table))


def is_elsewhere(table: str, signal: str) -> bool:
    """Whether the name of a table or of a topic says that a signal of it is that of another body."""
    return _is_elsewhere(frozenset(_words(table)), signal)


def is_time_step(column: str) -> bool:
    """Whether a name may mean the time from row to row as well."""
    return "_".join(_words(column)) in ("dt", "d_t", "delta_t")


def _is_of_another(words: list[str]) -> bool:
    return not _OTHERS.isdisjoint([*words, *map("_".join, pairwise(words))])


def _without_brackets(column: str, unit: str) -> tuple[str, str]:
    """A name, and the unit of its header or in its brackets."""
    base, in_brackets = split_unit(column.strip().lstrip("#%").strip())
    return base, (unit or in_brackets).strip().strip("[](){}").strip()


def _fits(unit: str, signal: str) -> bool:
    return dimension_fits(unit, "s" if signal == TIME else UNITS[signal])


def _words(name: str) -> list[str]:
    """Lower-case words of a name; an element [0] [1] [2] is x y z."""
    for written, plain in _WRITTEN.items():
        name = name.replace(written, plain)
    name = _FIELD_OF_ROS.sub("", name)
    name = _UNIT_BEFORE_INDEX.sub(_index_first, name)
    name = _INDEX.sub(lambda match: "_" + "xyzw"[min(int(match.group(1)), 3)], name)
    name = name.translate(_LETTERS)
    name = re.sub("Ao([AS])(?![a-z])", lambda match: f"ao{match.group(1).lower()}", name)  # one word, and no hump
    name = re.sub(r"([a-z])([A-Z])", r"\1_\2", name)
    name = re.sub(r"([A-Z]{2,})([A-Z][a-z]{2,})", r"\1_\2", name)
    return [_plain(word) for word in re.split(r"[^a-zA-Z0-9]+", name.lower()) if word]


def _index_first(match: re.Match[str]) -> str:
    """Of accel_mps2[0] accel[0]_mps2."""
    unit, index = match.groups()
    return f"[{index}]_{unit}" if unit in _UNIT_ENDINGS else match.group()


def _plain(word: str) -> str:
    """A source without its number: ahrs1 is ahrs."""
    source = word.rstrip("0123456789")
    return source if len(source) > 1 and source in _SOURCES else word


def _readings(words: list[str]) -> list[tuple[list[str], str, int]]:
    """Words without an ending that is a unit and without words of the source: tokens, unit, how much was left out."""
    if _is_of_another(words):
        return [(tokens, unit, 0) for tokens, unit in _without_unit(words) if "_".join(tokens) in _BY_NAME]
    found: list[tuple[list[str], str, int]] = []
    for tokens, unit in _without_unit(words):
        found.append((tokens, unit, 0 if unit or tokens is words else 1))
        kept = [word for word in tokens if word not in _SOURCES and not word.isdigit()]
        if kept and kept != tokens:
            found.append((kept, unit, len(tokens) - len(kept)))
        if len(tokens) > 1 and tokens[0] in _SOURCES:
            found.append((tokens[1:], unit, 1))
        joined = ["".join(tokens)]
        if len(tokens) > 1:
            found.append((joined, unit, 1))
    return found


def _readings_of_path(name: str) -> list[tuple[list[str], str, int]]:
    """Readings of the end of a path, as simulators name their properties: ``/position/latitude-deg``."""
    parts = name.strip().strip("/").split("/")
    is_path = len(parts) > 1 and all(len(part) > 2 for part in parts) and not _ends_as_unit(parts[-1])  # none is ax,m/s
    if not is_path or _is_of_another(_words(name)):
        return []
    for i in range(1, len(parts)):  # as much of it as is known: in a/velocity/north north is no position
        found = [each for each in _readings(_words("/".join(parts[i:]))) if "_".join(each[0]) in _BY_NAME]
        if found:
            where = frozenset(_words("/".join(parts[:i])))
            return [(tokens, unit, cost + i) for tokens, unit, cost in found if _is_there(where, tokens, unit)]
    return []


def _is_there(where: frozenset[str], tokens: list[str], unit: str) -> bool:
    """Whether the first words of a path leave it possible that its end is the signal that it is called."""
    signal = _BY_NAME["_".join(tokens)][0]
    quantities = [_QUANTITIES[word] for word in where if word in _QUANTITIES]
    if quantities and signal != TIME and not any(UNITS[signal] in units for units in quantities):
        return False
    is_input = not _INPUTS.isdisjoint(where) and not unit and (signal in _SURFACES or signal.startswith("attitude"))
    return not is_input and _DEMANDS.isdisjoint(where) and not _is_elsewhere(where, signal)


def _ends_as_unit(last: str) -> bool:
    """Whether what follows a "/" is the rest of a unit; pint has some for alpha and mass, too."""
    signal = _BY_NAME.get("_".join(_words(last)), (TIME,))[0]
    return is_unit(last) and (signal == TIME or last.lower() in _UNIT_ENDINGS)


def _is_elsewhere(words: frozenset[str], signal: str) -> bool:
    return bool(words & _ELSEWHERE) and signal not in _OF_ENGINES


def _without_unit(words: list[str]) -> list[tuple[list[str], str]]:
    """Words as they are, and without each ending that is a unit, with that unit."""
    found: list[tuple[list[str], str]] = [(words, "")]
    for count in (1, 2, 3):
        ending = "_".join(words[-count:])
        if len(words) > count and ending in _UNIT_ENDINGS:
            found.append((words[:-count], _UNIT_ENDINGS[ending]))
    return found
