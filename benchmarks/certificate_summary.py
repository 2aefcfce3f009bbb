"""Statistics of the certificate: coverage, bias, errors, times, and what the lines of its files say about them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from accuracy import MAIN_DERIVATIVES
from certificate_flights import AIRS, LOSS_DURATION, Record, first_moves, mode_periods, prepare, the_aircraft

Array = npt.NDArray[np.float64]

EXCITED = 3.0  # rms of what only this term does, over its noise, in recursive least squares: as the thresholds
NORMAL_95 = 1.96


def summarise(records: dict[str, list[Record]]) -> dict[str, Any]:
    """Everything that tables and figures show."""
    flown = [r for r in records["flights"] + records["refined"] if "failed" not in r]
    failed = [r for part in records.values() for r in part if "failed" in r]
    return {
        "modes": mode_periods(prepare(the_aircraft())),
        "excited": EXCITED,
        "methods": {m: {a: of_method(flown, m, a) for a in airs} for m, airs in _cells(flown).items()},
        "corrections": {a: corrections(flown, a) for a in _cells(flown).get("rls", [])},
        "same_flights": {air: same_flights(flown, air) for air in AIRS},
        "close": {m: {a: times_to_close(flown, m, a) for a in airs} for m, airs in _cells(records["flights"]).items()},
        "loss": {m: {a: losses(records["loss"], m, a) for a in airs} for m, airs in _cells(records["loss"]).items()},
        "failed": [{key: r[key] for key in ("seed", "air", "method", "failed")} for r in failed],
    }


def _cells(records: list[Record]) -> dict[str, list[str]]:
    """Which methods have flights in which air, in the order of the files."""
    found: dict[str, list[str]] = {}
    for r in records:
        airs = found.setdefault(r["method"], [])
        if r["air"] not in airs:
            airs.append(r["air"])
    return found


def select(records: list[Record], method: str, air: str) -> list[Record]:
    return [r for r in records if r["method"] == method and r["air"] == air]


def stack(records: list[Record], key: str) -> Array:
    """One row per flight, null as NaN."""
    return np.array([r[key] for r in records], dtype=np.float64)


def truth() -> tuple[list[str], Array]:
    names = list(the_aircraft().model.parameter_names)
    return names, np.array([the_aircraft().coefficients[name] for name in names])


def shares_within(z: Array, chosen: npt.NDArray[np.bool_]) -> dict[str, Any]:
    """Share of |z| <= 1.96 among the chosen of (flights, parameters), its standard error over flights, and rms of z."""
    inside = np.where(chosen, np.abs(z) <= NORMAL_95, np.nan)
    n = int(chosen.sum())
    if not n:
        return {"pairs": 0, "share": None, "error": None, "rms_z": None}
    weight = chosen.sum(axis=1)
    share = float(np.nansum(inside) / n)
    deviation = np.nansum(inside, axis=1) - share * weight
    error = float(np.sqrt(np.sum(deviation**2))) / n  # flights are independent, parameters of one are not
    return {"pairs": n, "share": share, "error": error, "rms_z": float(np.sqrt(np.mean(z[chosen] ** 2)))}


def of_method(records: list[Record], method: str, air: str) -> dict[str, Any]:
    """Coverage, bias and errors of one method in one air."""
    rows = select(records, method, air)
    names, true = truth()
    value, std = stack(rows, "value"), stack(rows, "std")
    known = np.isfinite(value) & np.isfinite(std)
    z = (value - true) / std
    excited = known & (stack(rows, "excitation") >= EXCITED)
    main = [names.index(name) for name in MAIN_DERIVATIVES]
    relative = value[:, main] / true[main] - 1.0
    return {
        "flights": len(rows),
        "unknown": float(1.0 - known.mean()),
        "excited": shares_within(z, excited),
        "all": shares_within(z, known),
        "use": {**shares_within(z, known & (stack(rows, "use") > 0)), "of_all": float(stack(rows, "use").mean())},
        "least_covered": _least_covered(names, z, excited),
        "bias": {name: _bias(relative[:, i]) for i, name in enumerate(MAIN_DERIVATIVES)},
        "bias_over_std": {name: _bias(z[:, i]) for i, name in enumerate(names)},
        "median_relative_error": float(np.nanmedian(np.abs(relative))),
        "p90_relative_error": float(np.nanpercentile(np.abs(relative), 90)),
        "rms_relative_error": {
            name: float(np.sqrt(np.nanmean(relative[:, i] ** 2))) for i, name in enumerate(MAIN_DERIVATIVES)
        },
        "cpu": float(np.median([r["cpu"] for r in rows])),
        "not_converged": int(sum(not r.get("converged", True) for r in rows)),
    }


def _bias(error: Array) -> dict[str, float | None]:
    there = error[np.isfinite(error)]
    if len(there) < 2:
        return {"mean": None, "error": None}
    return {"mean": float(there.mean()), "error": float(there.std(ddof=1) / np.sqrt(len(there)))}


def _least_covered(names: list[str], z: Array, chosen: npt.NDArray[np.bool_], most: int = 4) -> dict[str, float]:
    """The parameters whose intervals hold the truth least often, of those that are chosen in half of the flights."""
    shares = {
        name: float(np.mean(np.abs(z[chosen[:, i], i]) <= NORMAL_95))
        for i, name in enumerate(names)
        if chosen[:, i].mean() >= 0.5
    }
    return dict(sorted(shares.items(), key=lambda item: item[1])[:most])


def corrections(records: list[Record], air: str) -> dict[str, Any]:
    """What intervals of recursive least squares would be with other standard errors."""
    rows = select(records, "rls", air)
    error = stack(rows, "value") - truth()[1]
    excited = stack(rows, "excitation") >= EXCITED
    result = {}
    for key in ("white", "coloured", "std"):
        std = stack(rows, key)
        chosen = excited & np.isfinite(std)
        result[key] = {
            **shares_within(error / std, chosen),
            "ratio": float(np.nanmedian((stack(rows, "std") / std)[chosen])),
        }
    return result


def same_flights(records: list[Record], air: str) -> dict[str, Any]:
    """Rms error of every method on the flights that all of them have flown."""
    methods = list(_cells(records))
    seeds = [{r["seed"] for r in select(records, m, air)} for m in methods]
    common = sorted(set.intersection(*seeds)) if seeds else []
    if not common:
        return {"flights": 0, "methods": {}}
    names, true = truth()
    main = [names.index(name) for name in MAIN_DERIVATIVES]
    rms, close = {}, {}
    for method in methods:
        rows = [r for r in select(records, method, air) if r["seed"] in common]
        value, std = stack(rows, "value"), stack(rows, "std")
        rms[method] = np.sqrt(np.nanmean((value / true - 1.0) ** 2, axis=0))
        excited = np.isfinite(value / std) & (stack(rows, "excitation") >= EXCITED)
        close[method] = shares_within((value - true) / std, excited)
    baseline = rms.get("rls", rms[methods[0]])
    return {
        "flights": len(common),
        "methods": {
            method: {
                "median_rms_main": float(np.median(rms[method][main])),
                "worst_rms_main": float(np.max(rms[method][main])),
                "worst": MAIN_DERIVATIVES[int(np.argmax(rms[method][main]))],
                "over_rls": float(np.median(rms[method][main] / baseline[main])),
                "better_than": {
                    other: int(np.sum(rms[method][main] < rms[other][main])) for other in methods if other != method
                },
                "excited": close[method],
            }
            for method in methods
        },
    }


# -- in flight -------------------------------------------------------------------------------------------------------


def cycle_of(name: str, modes: dict[str, float]) -> float | None:
    """Period [s] of the mode that a main derivative belongs to; thrust belongs to none."""
    if name == "CX_Tc":
        return None
    return modes["short_period" if name[:2] in ("CX", "CZ", "Cm") else "dutch_roll"]


def times_to_close(records: list[Record], method: str, air: str) -> dict[str, Any]:
    """Time from the first manoeuvre of the axis until a derivative is near the truth for good; inf: not at the end."""
    rows, modes, begin = select(records, method, air), mode_periods(prepare(the_aircraft())), first_moves()
    result = {}
    for name in MAIN_DERIVATIVES:
        reached = [r["close"][name] for r in rows]
        after = np.array([np.inf if t is None else max(t - begin[name], 0.0) for t in reached])
        median, late = float(np.median(after)), float(np.quantile(after, 0.9, method="higher"))
        cycle = cycle_of(name, modes)
        result[name] = {
            "median": _finite(median),
            "p90": _finite(late),
            "cycles": None if cycle is None else _finite(median / cycle),
            "in_one_cycle": None if cycle is None else float(np.mean(after <= cycle)),
            "never": float(np.mean(np.isinf(after))),
        }
    return result


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def losses(records: list[Record], method: str, air: str) -> dict[str, Any]:
    """Delays of detection, false alarms, and when C_m,de is near its new truth."""
    rows = [r for r in select(records, method, air) if "failed" not in r]
    lost, sound = [r for r in rows if r["lost"]], [r for r in rows if not r["lost"]]
    return {
        "lost": len(lost),
        "sound": len(sound),
        "alarm": _delays([r["alarm"] for r in lost]),
        "alarms": _mean([r["alarms"] for r in lost]),
        "false_alarms": sum(r["false_alarms"] for r in rows),
        "minutes": (len(sound) * LOSS_DURATION + sum(r["at"] for r in lost)) / 60.0,
        "wrong_use": _delays([r["wrong_use"] for r in lost]),
        "wrong_sign": _share(lost, lambda r: r["wrong_sign"]),
        "in_use": _delays([r["in_use"] for r in lost]),
        "close": _delays([r["close"] for r in lost]),
        "close_after_moves": _delays([None if r["close"] is None else max(r["close"] - r["moves"], 0) for r in lost]),
        "end": _middle([r["end"] for r in lost]),
        "end_z_within_95": _share(lost, lambda r: r["end_z"] is not None and abs(r["end_z"]) <= NORMAL_95),
        "nothing_known": _share(lost, lambda r: r["end"] is None),
    }


def _delays(values: list[float | None]) -> dict[str, float | None]:
    """Share that came at all, median and 90th percentile [s] over all, null where that is never."""
    if not values:
        return {"share": None, "median": None, "p90": None}
    times = np.array([np.inf if v is None else v for v in values])
    late = float(np.quantile(times, 0.9, method="higher"))
    share = float(np.mean(np.isfinite(times)))
    return {"share": share, "median": _finite(float(np.median(times))), "p90": _finite(late)}


def _share(rows: list[Record], test: Any) -> float | None:
    return float(np.mean([test(r) for r in rows])) if rows else None


def _mean(values: list[float | None]) -> float | None:
    there = [v for v in values if v is not None]
    return float(np.mean(there)) if there else None


def _middle(values: list[float | None]) -> float | None:
    there = [v for v in values if v is not None]
    return float(np.median(there)) if there else None
