"""The diagnosis of a run, or of several as one body, kept in the run where it is one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.after_flight.progress import Tell, nobody
from aircraft_sysid_ros.diagnosis.flight_answer import diagnose_run, diagnose_runs
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.run_reader import DIAGNOSIS
from aircraft_sysid_ros.run_writer import write_json

FEWEST, MOST = 2, 50


def diagnose(runs: Sequence[str | Path], replicas: int = COUNT, tell: Tell = nobody) -> dict[str, Any]:
    """What ``diagnose --json`` prints, with the ``file`` that keeps it; nothing is written of several runs.

    Raises InputError.

    ``replicas``: flights without the effect that the evidence is compared with.
    """
    check_replicas(replicas)
    if len(runs) > 1:
        return {**diagnose_runs(runs, replicas, tell), "file": None}
    result, folder = diagnose_run(runs[0], replicas, tell)
    result["file"] = str(folder / DIAGNOSIS)
    try:
        write_json(folder / DIAGNOSIS, result)
    except OSError:  # the answer is worth more than its copy
        result["file"] = None
    return result


def check_replicas(replicas: int) -> None:
    """Raises InputError for a number of replicas of which nothing can be said, or that nobody can wait for."""
    if not isinstance(replicas, int) or not FEWEST <= replicas <= MOST:
        raise InputError(f"--replicas must be from {FEWEST} to {MOST}, not {echo(str(replicas))}")
