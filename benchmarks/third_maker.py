"""Flights of a third maker, from strip theory: what does the diagnosis say with an aircraft file of mass and shape?

    python benchmarks/third_maker.py [--judging] [--most 6] [--jobs 1] [--results FILE]

The maker (``makers/strip_theory``) knows nothing of the model, of the simulator and of the replicas. Each flight is
written as CSV and goes through import, replay and diagnose as a user types them. Rules are made on the flights of
DEVELOPMENT; those of JUDGING were drawn before and are looked at once, when the rules stand. Each flight is a line in
results/third_maker.jsonl (or _development); a run that is stopped goes on where it was. The ground of low passes lies
below the aeroplane since the third rules; that of JUDGING was at half a span or above.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import resumed
from walked import walked

from aircraft_sysid_ros.effects.aliases import aliases_of

sys.path.insert(0, str(Path(__file__).parent / "makers"))

from strip_theory.hidden import EFFECTS, FURTHER, make

RESULTS = Path(__file__).parent / "results" / "third_maker.jsonl"
DEVELOPED = RESULTS.with_name("third_maker_development.jsonl")


def _drawn(first: int, clean: int, effects: Iterable[str] = EFFECTS) -> tuple[tuple[int, str | None], ...]:
    """Seeds with what is hidden: clean ones, and one of each effect, in turns."""
    hidden = [(first + 100 + n, effect) for n, effect in enumerate(effects)]
    flights: list[tuple[int, str | None]] = [(first + n, None) for n in range(clean)]
    return tuple(pair for n in range(max(clean, len(hidden))) for pair in (*flights[n : n + 1], *hidden[n : n + 1]))


#: Rules are made while these are looked at.
DEVELOPMENT = _drawn(710_000, 12)
#: And judged on these. No list is changed once it has been committed.
JUDGING = _drawn(930_000, 17)
#: Of these a look at JUDGING says nothing any more: what had no name, or not the first, was then looked into.
MISSED = ("flaps", "engine_cut", "ground", "propeller_wash", "half_fin", "half_elevator")
#: And judged on fresh ones, what was missed before the rest.
JUDGING_2 = _drawn(950_000, 17, (*MISSED, *(effect for effect in EFFECTS if effect not in MISSED)))
#: And on fresh ones once more, after the rules for late vanes and for sizes that tails have.
JUDGING_3 = _drawn(970_000, 17)
#: And on one aileron of two, which came later: its rules were made on seeds from 711000 on.
JUDGING_4 = _drawn(980_000, 2, ("one_aileron",) * 6)

#: Number of the rules that a flight was judged by, in its line; 1 where it has none. It rises with the next rules.
RULES = 9

RIGHT, IN_SET, LATER, UNEXPLAINED, NONE, WRONG = "first", "in its set", "later", "unexplained", "none", "wrong"


def fly(job: dict[str, Any]) -> dict[str, Any]:
    """Make one flight, and what is said of it."""
    with tempfile.TemporaryDirectory() as name:
        folder, begun = Path(name), time.time()
        try:
            result = {**job, **make(job["seed"], job["effect"], folder / "log")}
        except ValueError as error:
            return {**job, "failed": str(error)}
        result |= {**said_of(folder), "took": round(time.time() - begun)}
    if "failed" in result:
        return result
    outcome, besides = judged(result)
    return {**result, "rules": RULES, "outcome": outcome, "besides": besides}


def said_of(folder: Path) -> dict[str, Any]:
    """The answer of diagnose about the log in a folder."""
    log, bag, run = folder / "log", folder / "bag", folder / "run"
    failed = walked(
        ["import", log, "--map", log / "map.yaml", "--out", bag],
        ["replay", bag, "--aircraft", log / "plane.yaml", "--out", run],
        ["diagnose", run],
    )
    if failed:
        return {"failed": failed}
    said = json.loads((run / "diagnosis.json").read_text(encoding="utf8"))
    keys = ("label", "effect", "main_axis", "inner", "p_value", "error_before", "error_after", "confounded_with")
    return {
        "verdict": said["verdict"],
        "p_value": said.get("p_value"),  # none where an input has failed: the library is not searched then
        "found": [{key: each.get(key) for key in keys} for each in said["candidates"] if each["found"]],
        "listed": [each["label"] for each in said["candidates"] if not each["found"]],
        "unknown": said.get("unknown"),
        "unseen": [each["effect"] for each in said.get("cannot_show", ())],
    }


def true_besides(result: dict[str, Any]) -> set[str]:
    """What is true of flights of this maker and stands in no file: places and smoothing of sensors, the wake's lag.

    Of strips roll and yaw derivatives are in proportion to lift: from an angle of attack of 0 to 0.1 C_l,r doubles, and
    C_n,p and C_n,da begin at none (test/test_third_maker.py). And a wing that gets slow stalls: a pilot whose engine
    stops holds his height until it does.
    """
    true = {"alpha_dot", "thrust_offset", "lateral_rates_alpha", "adverse_yaw"}
    true |= {"stall", "dynamic_stall"} if result.get("stalled") else set()
    true |= {"imu_offset"} if any(result["imu_place"]) else set()
    true |= {"probe_offset"} if result["boom"] else set()
    true |= {"gps_lag"} if result["gps_delay"] else set()
    return true | ({"imu_lag", "air_data_lag"} if result["smoothing"] + 0.3 / result["rate"] > 0.02 else set())


def judged(result: dict[str, Any]) -> tuple[str, list[str]]:
    """How the answer stands to what was hidden, and names that were given besides and are not true."""
    named = [each for each in result["found"] if each["effect"] not in true_besides(result) - _wanted(result)]
    wanted = _wanted(result)
    others = [each["label"] for each in named if each["effect"] not in wanted]
    if not named:
        return NONE, []
    first = named[0]
    if first["effect"] in wanted:
        return RIGHT, others
    if any(each["effect"] in wanted for each in named):
        return LATER, others
    if first["effect"] is None:
        return UNEXPLAINED, others[1:]
    near = {first["effect"], *aliases_of(first["effect"]), *(first["confounded_with"] or ())}
    return (IN_SET, others[1:]) if wanted & near else (WRONG, others)


def _wanted(result: dict[str, Any]) -> set[str]:
    return set((EFFECTS | FURTHER)[result["effect"]]) if result["effect"] else set()


def summary(results: list[dict[str, Any]]) -> str:
    """Counts, and each flight that was not right."""
    done = [r for r in results if "failed" not in r]
    clean = [r for r in done if r["effect"] is None]
    hidden = [r for r in done if r["effect"] is not None]
    false = [r for r in clean if judged(r)[0] != NONE]
    kinds = Counter(judged(r)[0] for r in hidden)
    lines = [
        f"clean: {len(clean)}, given a verdict that is not true: {len(false)}",
        f"with an effect: {len(hidden)}: {dict(kinds)}",
        *(f"  {r['seed']} {r['effect']}: {judged(r)} {[f['label'] for f in r['found']]}" for r in (*false, *hidden)),
        *(f"  {r['seed']} {r['effect']}: {r['failed']}" for r in results if "failed" in r),
    ]
    return "\n".join(lines)


def main() -> None:
    """Fly what is not flown yet, and count."""
    parser = resumed.options(__doc__)
    parser.add_argument("--judging", action="store_true", help="the flights that rules are judged on")
    parser.add_argument("--most", type=int, default=1000, help="flights that are flown now")
    parser.add_argument("--only", type=int, nargs="*", help="seeds")
    parser.set_defaults(jobs=1)
    args = parser.parse_args()
    path = args.results or (RESULTS if args.judging else DEVELOPED)
    known = {json.loads(line)["seed"] for line in path.read_text().splitlines()} if path.exists() else set()
    listed = [
        {"seed": seed, "effect": effect}
        for seed, effect in ((*JUDGING, *JUDGING_2, *JUDGING_3, *JUDGING_4) if args.judging else DEVELOPMENT)
    ]
    listed = [job for job in listed if not args.only or job["seed"] in args.only]
    new = [job for job in listed if job["seed"] not in known][: args.most]
    wanted = [job for job in listed if job["seed"] in known] + new
    print(summary(resumed.flown_aloud(fly, wanted, path, args.jobs, _says)))


def _says(result: dict[str, Any]) -> str:
    return f"{result['effect']} {[each['label'] for each in result.get('found', [])]}"


if __name__ == "__main__":
    main()
