"""What `fleet` says of parameter tables with known truth: false alarms, drift, dates.

    python benchmarks/fleet_changes.py

Fleets of 8 airframes with 32 parameters each are drawn, not flown: standard errors that differ by flight and parameter,
a spread between flights of none to three times those, errors that are correlated between the parameters of a flight, a
fifth of the values without USE. The rules were made on the seeds 0 to 99; these are 1000 and on.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.fleet.changes import DRIFT, JUMP, RATE, Change, Series, change_of, named

Array = npt.NDArray[np.float64]

RESULT = Path(__file__).parent / "results" / "fleet_changes.json"
PIECES = Path(__file__).resolve().parents[1] / "build" / "fleet" / "changes.json"
AIRFRAMES, PARAMETERS, FIRST_SEED = 8, 32, 1000
FLIGHTS = (10, 25, 50)
HEALTHY, CHANGED = 40, 20  # fleets by number of flights
#: Total of a change in units of the spread of the values, standard errors and flights together.
SIZES = (2.0, 4.0, 8.0)
CORRELATION, MISSING = 0.5, 0.2


def fleet(seed: int, flights: int, drift: float = 0.0, jump: float = 0.0) -> Iterator[tuple[Series, tuple[str, int]]]:
    """Series of a fleet with the truth: kind and number of the first flight of a jump.

    In the first airframe every second parameter drifts, in the second one every second jumps at one date.
    """
    rng = np.random.default_rng(seed)
    for airframe in range(AIRFRAMES):
        together = rng.normal(size=flights)
        at = int(rng.integers(3, flights - 3))
        for parameter in range(PARAMETERS):
            std = np.exp(rng.normal(0.0, 0.4, flights))
            own = np.sqrt(1.0 - CORRELATION) * rng.normal(size=flights)
            error = std * (np.sqrt(CORRELATION) * together * (-1) ** parameter + own)
            between = rng.choice([0.0, 0.5, 1.0, 3.0])
            spread = np.sqrt(np.mean(std**2) + between**2)
            value = error + between * rng.normal(size=flights)
            truth = ("none", 0)
            number = np.arange(flights)
            if airframe == 0 and drift and parameter % 2:
                value, truth = value + drift * spread * number / (flights - 1), (DRIFT, 0)
            if airframe == 1 and jump and parameter % 2:
                value, truth = value + jump * spread * (number >= at), (JUMP, at)
            used = rng.random(flights) >= MISSING
            airspeed = 20.0 + rng.normal(0.0, 0.4, flights)
            yield Series(number[used], value[used], std[used], airspeed[used]), (*truth, spread)


def judged(seed: int, flights: int, size: float = 0.0) -> list[tuple[bool, Change, tuple[str, int, float], Array]]:
    """All series of a fleet that were judged: named or not, the change, the truth, the numbers of the flights."""
    drawn = [(change_of(series), truth, series.number) for series, truth in fleet(seed, flights, size, size)]
    found = [each for each in drawn if each[0] is not None]
    are_named = named([change.p_value for change, *_ in found])
    return [(bool(is_named), *each) for is_named, each in zip(are_named, found, strict=True)]


def healthy(flights: int) -> dict[str, float]:
    """Fleets in which nothing changes."""
    fleets = [judged(FIRST_SEED + seed, flights) for seed in range(HEALTHY)]
    alarms = [sum(is_named for is_named, *_ in each) for each in fleets]
    return {
        "flights": flights,
        "fleets": HEALTHY,
        "series": sum(map(len, fleets)),
        "named": sum(alarms),
        "fleets_with_alarm": sum(count > 0 for count in alarms),
    }


def changed(flights: int, size: float) -> dict[str, float]:
    """Fleets with one airframe that drifts and one that jumps."""
    count = {kind: {"there": 0, "named": 0, "kind": 0, "inside": 0, "date": 0} for kind in (DRIFT, JUMP)}
    false, all_named = 0, 0
    for seed in range(CHANGED):
        for is_named, change, (kind, at, spread), numbers in judged(2 * FIRST_SEED + seed, flights, size):
            all_named += is_named
            false += is_named and kind == "none"
            if kind == "none":
                continue
            one = count[kind]
            one["there"] += 1
            one["named"] += is_named
            if not (is_named and change.kind == kind):
                continue
            one["kind"] += 1
            true = size * spread / (flights - 1 if kind == DRIFT else 1)
            one["inside"] += bool(abs(change.size - true) <= 1.96 * change.std)
            first = int(numbers[numbers >= at][0]) if kind == JUMP else 0
            one["date"] += bool(abs(change.number - first) <= 1)
    return {"flights": flights, "size": size, "fleets": CHANGED, "false": false, "named": all_named, **count}


def main() -> None:
    """Fleets of one kind after the other, each kept when it is done: what is there is not drawn again."""
    pieces = json.loads(PIECES.read_text(encoding="utf8")) if PIECES.exists() else {}
    for flights in FLIGHTS:
        for size in (0.0, *SIZES):
            name = f"{flights} {size:g}"
            if name not in pieces:
                pieces[name] = changed(flights, size) if size else healthy(flights)
                PIECES.parent.mkdir(parents=True, exist_ok=True)
                PIECES.write_text(json.dumps(pieces), encoding="utf8")
    result = {
        "rate": RATE,
        "airframes": AIRFRAMES,
        "parameters": PARAMETERS,
        "healthy": [pieces[f"{flights} 0"] for flights in FLIGHTS],
        "changed": [pieces[f"{flights} {size:g}"] for flights in FLIGHTS for size in SIZES],
    }
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
