"""Tables of docs/fleet.md: changes between flights that were named, and a simulated fleet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from results import Rows


def healthy(result: Mapping[str, Any]) -> Rows:
    """False alarms."""
    header = ["flights of each airframe", "healthy fleets", "parameters in all", "changes named", "fleets with one"]
    keys = ("flights", "fleets", "series", "named", "fleets_with_alarm")
    return header, [[str(row[key]) for key in keys] for row in result["healthy"]]


def changed(result: Mapping[str, Any]) -> Rows:
    """Drifts and jumps that were there."""
    header = ["flights", "size", "false of all named"]
    header += ["drifts named", "as drift", "rate inside 95 %", "jumps named", "as jump", "size inside 95 %"]
    header += ["date within one flight"]
    rows = []
    for row in result["changed"]:
        drift, jump = row["drift"], row["jump"]
        rows.append([
            str(row["flights"]), f"{row['size']:g}", f"{row['false']} of {row['named']}", *_shares(drift),
            *_shares(jump), _share(jump["date"], jump["kind"]),
        ])  # fmt: skip
    return header, rows


def _shares(one: Mapping[str, int]) -> list[str]:
    named = _share(one["named"], one["there"])
    return [named, _share(one["kind"], one["named"]), _share(one["inside"], one["kind"])]


def _share(count: int, of: int) -> str:
    return f"{100.0 * count / of:.0f} %" if of else "–"


def whole(result: Mapping[str, Any]) -> Rows:
    """What was hidden in the whole simulated fleet, what was named, and what was named that is none."""
    true = {(row["airframe"], row["parameter"]) for row in result["truth"]}
    heavy, others = [], []
    for each in result["differences"]:
        is_force = each["airframe"] == "heavy" and each["parameter"].startswith(("CX_", "CY_", "CZ_"))
        if is_force:
            heavy.append(each["parameter"])
        elif (each["airframe"], each["parameter"]) not in true:
            others.append(f"{each['airframe']} {each['parameter']}")
    failed = ", ".join(f["flight"] for f in result["other_failures"]) or "none"
    header, rows = _truths(result)
    rows += [
        [
            "heavy",
            "forces, 10 % more mass than its file says",
            "all smaller by 9 %",
            f"{' '.join(heavy) or 'none'} differ",
        ],
        ["all", "differences named that are none", "", ", ".join(others) or "none"],
        ["all", "flights", f"{result['flights'] - result['damaged']}", f"not used: {failed}"],
    ]
    return header, rows


def small(result: Mapping[str, Any]) -> Rows:
    """The same of the small one, and what a flight costs with its diagnosis."""
    header, rows = _truths(result)
    each = result["cpu_per_flight"]
    hours = f"{each * 1e6 / 3600.0:,.0f}".replace(",", " ")
    rows += [
        ["each flight", "processor time, bytes of its answer", f"{each:.1f} s", f"{result['bytes_per_answer']:.0f}"],
        ["a million", "core hours, of answers", hours, f"{result['bytes_per_answer'] / 1e3:.1f} GB"],
    ]
    return header, rows


def _truths(result: Mapping[str, Any]) -> Rows:
    """What was hidden in a simulated fleet, and what was named."""
    rows = []
    for row in result["truth"]:
        since = f" from {row['airframe']}/{row['flight']:03d}" if row["kind"] == "jump" else " per flight"
        found = row["found"]
        std = row.get("std_of_a_flight")
        said = f"not named: in a flight ± {1.96 * std:.3f}" if std else "not named"
        if found:
            where = f" from {found['flight']}" if found["kind"] == "jump" else " per flight"
            said = f"{found['kind']} {found['size']:+.4f} ± {1.96 * found['std']:.4f}{where}"
        rows.append([row["airframe"], row["parameter"], f"{row['kind']} {row['size']:+.4f}{since}", said])
    others = ", ".join(f"{c['airframe']} {c['parameter']}" for c in result["other_changes"]) or "none"
    rows.append(["all", "changes named that are none", "", others])
    rows.append(["damaged", "files named, of those that are damaged or hang", str(result["damaged"]),
                 str(result["damaged_named"])])  # fmt: skip
    return ["airframe", "parameter", "truth", "named, with 95 % interval"], rows


def killed(result: Mapping[str, Any]) -> Rows:
    """A fleet whose workers are killed, and the same undisturbed."""
    rows = []
    for name, words in (("undisturbed", "one worker"), ("killed", f"two, one killed every {result['every']:g} s")):
        one = result[name]
        rows.append([words, str(one["flights"]), str(one["ok"]), str(one["kills"]), f"{one['wall']:.0f} s"])
    same = f"{len(result['same'])} of {len(result['tables'])}"
    return ["workers", "flights", "used", "workers killed", "took"], [
        *rows,
        ["tables that are the same to the last byte", same, "", "", ""],
    ]


def costs(result: Mapping[str, Any]) -> Rows:
    """What a fleet costs, in processor time: the machine is shared."""
    one, two, count, plain = result["workers_1"], result["workers_2"], result["flights"], result["plain_cpu"]
    ahead, scaling = one["flights_cpu"] / plain - 1.0, 2.0 * one["flights_cpu"] / two["flights_cpu"]
    rows = [
        ["scheduler, client and worker, for each flight", f"{1000.0 * result['own']:.0f} ms"],
        [f"{count} flights one after the other in one process", f"{plain:.1f} s"],
        [
            "the same in a fleet of one worker, in the processes of the flights",
            f"{one['flights_cpu']:.1f} s ({100 * ahead:+.1f} %)",
        ],
        ["the same in a fleet of two workers", f"{two['flights_cpu']:.1f} s"],
        ["so two workers fly, by processor time, as many flights as one, times", f"{scaling:.2f}"],
        ["wall-clock time of the command, with one worker and with two", f"{one['wall']:.0f} s, {two['wall']:.0f} s"],
        ["load of the machine's two cores at the end of both", f"{one['load']:.1f}, {two['load']:.1f}"],
    ]
    return ["measured", ""], rows


#: Parameters of the table by name, and how they are called in it; the others count in the mean over all.
_SHOWN = ("CZ_q", "CZ_de", "Cl_dr", "Cn_dr", "CY_da", "CX_0")


def prior(result: Mapping[str, Any]) -> Rows:
    """Time until parameters are known, with the prior of a fleet and without."""
    rows, names = [], result["names"]
    for words, changed in (("the same aeroplane", False), ("one derivative changed before", True)):
        flights = [flight for flight in result["flights"] if bool(flight["factors"]) == changed]
        both = [[flight[key] for flight in flights] for key in ("without", "with")]

        def row(what: str, of: Callable[[Any], str], both: Any = both) -> list[str]:
            return ["", what, *map(of, both)]

        rows.append([f"{words}, {len(flights)} flights", "", "", ""])
        rows.append(
            row(
                "mean time to the first USE of a parameter",
                lambda b: f"{_mean(result, [b_['first'] for b_ in b]):.1f} s",
            )
        )
        if changed:
            own = [names.index(next(iter(flight["factors"]))) for flight in flights]
            rows.append(row("time until the changed one is to USE and right", lambda b, own=own: (
                f"{_mean(result, [[one['right'][j]] for one, j in zip(b, own, strict=True)]):.1f} s"
            )))  # fmt: skip
            rows.append(row("the changed one is wrong with USE, in all flights", lambda b, own=own: (
                f"{sum(one['wrong'][j] for one, j in zip(b, own, strict=True))} s"
            )))  # fmt: skip
        else:
            rows += [
                row(f"of {name}", lambda b, j=j: f"{_mean(result, [[one['first'][j]] for one in b]):.1f} s")
                for j, name in enumerate(names)
                if name in _SHOWN
            ]
        if changed:
            later = [
                (w["right"][j] or result["duration"]) > (o["right"][j] or result["duration"])
                for o, w, j in zip(*both, own, strict=True)
            ]
            rows.append(["", "flights in which it is right later than without", "", str(sum(later))])
        rows.append(row("of the time with USE a value is wrong in", lambda b: _of_use(b, "wrong")))
        rows.append(row("of the time with USE the truth is outside of 95 % in", lambda b: _of_use(b, "beyond")))
        dropped = sum(time is not None for one in both[1] for time in one["dropped"])
        rows.append(["", "axes whose prior was dropped", "", f"{dropped} of {6 * len(flights)}"])
    return ["", "", "without", "with the prior"], rows


def _of_use(flights: Any, key: str) -> str:
    return f"{100.0 * sum(sum(one[key]) for one in flights) / sum(sum(one['used']) for one in flights):.1f} %"


def _mean(result: Mapping[str, Any], times: Any) -> float:
    """Of times [s]; a parameter that is never known counts with the whole flight."""
    listed = [result["duration"] if time is None else time for each in times for time in each]
    return float(sum(listed) / len(listed))


def health(result: Mapping[str, Any]) -> Rows:
    """Faults in flight that were said, when, and how large; and what was said of nothing."""
    rows = []
    for case, (kind, size) in result["truth"].items():
        flights = [flight for flight in result["flights"] if flight["case"] == case]
        found = [_said_of(flight, kind) for flight in flights]
        named = [said for said in found if said is not None]
        alone = sum(len(said["kinds"]) == 1 for said in named)
        others = sum(any(s["kinds"] and kind not in s["kinds"] for s in flight["said"]) for flight in flights)
        hours = sum(flight["duration"] for flight in flights) / 3600.0
        times = sorted(said["time"] for said in named)
        sizes = [said["size"] for said in named if said["kinds"][0] == kind]
        rows.append([
            f"{case}, {len(flights)} flights of {hours:.1f} h" if not kind else f"{case}, {len(flights)} flights",
            f"{len(named)} ({alone} alone)" if kind else "–",
            f"{times[len(times) // 2]:.0f} s ({times[0]:.0f} to {times[-1]:.0f})" if times else "–",
            f"{100 * sum(sizes) / len(sizes):+.0f} % of {100 * size:+.0f} %" if sizes else "–",
            f"{others} ({others / hours:.1f} per hour)" if not kind else str(others),
        ])  # fmt: skip
    return [
        "what is wrong",
        "said",
        "median time until then",
        "mean size at the end",
        "flights with another one said",
    ], rows


def _said_of(flight: Mapping[str, Any], kind: str) -> Mapping[str, Any] | None:
    """When a kind was first said in a flight, alone or as one of several, with its newest size."""
    said = [each for each in flight["said"] if kind in each["kinds"]]
    return {**said[-1], "time": said[0]["time"]} if said else None


def million(small: Mapping[str, Any], costs: Mapping[str, Any], constants: Mapping[str, Any]) -> Rows:
    """What a flight costs, and a million of them."""
    each = constants["each"]
    times = {
        "import, check, replay, compare, diagnose": small["cpu_per_flight"],
        "scheduler, client and worker": costs["own"],
        "the key of a recording of 10 MB": 10.0 * constants["megabyte"],
        "an answer written, and read when it is begun again": each["keep"] + each["read"],
        "rows of its tables": each["tables"],
        f"changes between flights, of airframes with {constants['of_one']}": each["between"],
        "Parquet": each["write"],
    }
    rows = [
        [what, _short(seconds), f"{1e6 * seconds / 3600.0:,.1f} h".replace(",", " ")] for what, seconds in times.items()
    ]
    sizes = {
        "its answer on disk": small["bytes_per_answer"], "its rows in memory": each["memory"],
        "its rows in Parquet": each["parquet"],
    }  # fmt: skip
    rows += [[what, f"{size / 1e3:.1f} kB", f"{size / 1e3:.1f} GB"] for what, size in sizes.items()]
    return ["processor time and bytes of", "one flight", "a million"], rows


def _short(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds >= 1.0 else f"{1e3 * seconds:.1f} ms"
