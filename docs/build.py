"""Fill the tables of README.md and docs/*.md from benchmarks/results, to which the story of the last demo is copied.

    python docs/build.py

A table stands between ``<!-- table NAME -->`` and ``<!-- end -->``; its numbers are never typed. With --check nothing
is written and a table that is out of date is an error. What a table holds is in ``*_tables.py``, by page.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from collections.abc import Callable
from functools import partial

import accuracy_tables
import calibration_tables
import certificate_tables
import check_tables
import closed_loop_tables
import diagnosis_tables
import export_tables
import fleet_tables
import gusts_tables
import jsbsim_tables
import library_tables
import mavlink_tables
import node_tables
import paper_tables
import polar_tables
import real_flight_tables
import speed_tables
import threshold_tables
import topic_tables
import trust_tables
from params_file import params_file
from results import RESULTS, ROOT, from_code, from_flights, from_summary

PARAMS = ROOT / "config" / "params.yaml"
MARKER = re.compile(r"(<!-- table (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

#: Writes each table, by its name in the pages.
TABLES: dict[str, Callable[[], str]] = {
    **accuracy_tables.TABLES,
    **diagnosis_tables.HIDDEN_EFFECTS,
    **jsbsim_tables.TABLES,
    **library_tables.TABLES,
    **real_flight_tables.TABLES,
    **speed_tables.TABLES,
    **{f"calibration_{name}": from_summary(make, calibration_tables.SOURCES.get(name, "calibration"))
       for name, make in calibration_tables.TABLES.items()},
    **{f"certificate_{name}": from_summary(make, "certificate") for name, make in certificate_tables.TABLES.items()},
    **{f"check_{name}": from_summary(make, "flight_check") for name, make in check_tables.TABLES.items()},
    **{f"closed_loop_{name}": from_summary(make, "closed_loop") for name, make in closed_loop_tables.TABLES.items()},
    **{f"export_{name}": from_summary(make, "export") for name, make in export_tables.TABLES.items()},
    **{f"gusts_{name}": from_summary(make, "gusts") for name, make in gusts_tables.TABLES.items()},
    **{f"mavlink_{name}": from_summary(make, "mavlink_bridge") for name, make in mavlink_tables.TABLES.items()},
    **{f"nodes_{name}": from_code(make) for name, make in node_tables.TABLES.items()},
    **{f"paper_{name}": from_summary(make, "paper") for name, make in paper_tables.TABLES.items()},
    **{name: from_code(partial(threshold_tables.thresholds, record))
       for name, record in threshold_tables.RECORDS.items()},
    **{f"topics_{name}": from_code(make) for name, make in topic_tables.TABLES.items()},
    **{f"trust_{name}": from_summary(make, "bad_minute") for name, make in trust_tables.TABLES.items()},
    "aircraft_keys": from_code(node_tables.aircraft_keys),
    "airspeed_faults": from_flights(trust_tables.airspeed_faults, "airspeed_faults"),
    "alias_sets": from_code(diagnosis_tables.alias_sets),
    "certificate_cells": from_summary(certificate_tables.every_cell, "certificate_cells"),
    "certificate_parts": from_summary(certificate_tables.by_dimension, "certificate_cells"),
    "clean_residuals": from_flights(diagnosis_tables.clean_residuals, "clean_residuals"),
    "diagnosis_speed": from_summary(diagnosis_tables.speed, "diagnosis_speed"),
    "failures": from_flights(diagnosis_tables.failures, "failures"),
    "failures_again": from_flights(diagnosis_tables.failures_again, "failures"),
    "faults": from_summary(trust_tables.faults, "faults"),
    "faults_now": from_summary(trust_tables.faults, "faults_now"),
    "fleet_changed": from_summary(fleet_tables.changed, "fleet_changes"),
    "fleet_costs": from_summary(fleet_tables.costs, "fleet_costs"),
    "fleet_healthy": from_summary(fleet_tables.healthy, "fleet_changes"),
    "fleet_health": from_summary(fleet_tables.health, "fleet_health"),
    "fleet_killed": from_summary(fleet_tables.killed, "fleet_killed"),
    "fleet_million": from_summary(fleet_tables.million, "fleet_small", "fleet_costs", "fleet_constants"),
    "fleet_prior": from_summary(fleet_tables.prior, "fleet_prior"),
    "fleet_small": from_summary(fleet_tables.small, "fleet_small"),
    "fleet_whole": from_summary(fleet_tables.whole, "fleet"),
    "further_effects": from_flights(diagnosis_tables.further_effects, "further_effects"),
    "jet": from_flights(diagnosis_tables.jet, "jet"),
    "lags": from_flights(diagnosis_tables.lags, "missions"),
    "late_records": from_flights(diagnosis_tables.late_records, "late_records"),
    "lost_samples": from_flights(trust_tables.lost_samples, "lost_samples_before", "lost_samples"),
    "missions": from_flights(diagnosis_tables.missions, "missions"),
    "missions_strangers": from_flights(diagnosis_tables.missions, "missions_strangers"),
    "miswired": from_summary(check_tables.miswired, "miswired"),
    "other_aeroplanes": from_flights(diagnosis_tables.other_aeroplanes, "other_aeroplanes"),
    "polar_seaway": from_summary(polar_tables.seaway, "polar_seaway"),
    "polar_truth": from_flights(polar_tables.truth, "polar"),
    "small_airspeed_error": from_flights(trust_tables.small_airspeed_error, "small_airspeed_error"),
    "stalls": from_flights(diagnosis_tables.stalls, "stalls"),
    "stalls_in_flight": from_summary(trust_tables.stalls_in_flight, "stalls_in_flight"),
    "strangers": from_flights(diagnosis_tables.strangers, "strangers"),
    "strangers_placed": from_flights(diagnosis_tables.strangers, "strangers_placed"),
    "third_maker": from_flights(diagnosis_tables.third_maker, "third_maker"),
    "trimmed_jet": from_flights(diagnosis_tables.trimmed_jet, "trimmed_jet"),
    "use_audit": from_summary(trust_tables.use_audit, "use_audit"),
}  # fmt: skip


def copy_story() -> None:
    """Result and picture of `make demo`, if it was run here."""
    demo = ROOT / "runs" / "demo"
    if (demo / "story.json").exists():
        shutil.copy(demo / "story.json", RESULTS)
        shutil.copy(demo / "story.png", ROOT / "docs" / "figures")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only say whether a table is out of date")
    arguments = parser.parse_args()
    if not arguments.check:
        copy_story()
    stale = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = page.read_text(encoding="utf8")
        new = MARKER.sub(lambda match: match[1] + TABLES[match[2]]() + match[3], text)
        if new != text:
            stale.append(page.name)
            if not arguments.check:
                page.write_text(new, encoding="utf8")
    if (new := params_file()) != PARAMS.read_text(encoding="utf8"):
        stale.append(PARAMS.name)
        if not arguments.check:
            PARAMS.write_text(new, encoding="utf8")
    verb = "out of date: " if arguments.check else "written: "
    print(verb + ", ".join(stale) if stale else "every table is up to date")
    return int(bool(stale) and arguments.check)


if __name__ == "__main__":
    sys.exit(main())
