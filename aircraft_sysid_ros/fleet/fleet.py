"""A fleet from its sources to its tables and its page."""

from __future__ import annotations

import itertools
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.apart import Failed, Limits
from aircraft_sysid_ros.fleet.between import Between, between_flights
from aircraft_sysid_ros.fleet.cluster import Work, cluster, fly_all, has_dashboard
from aircraft_sysid_ros.fleet.flight_task import (
    Answer,
    Job,
    Options,
    answer_of,
    content_key,
    program_key,
    program_place,
)
from aircraft_sysid_ros.fleet.flights import Files, Flight, check_run_folders, flights_of
from aircraft_sysid_ros.fleet.folder import FLIGHTS, is_fleet
from aircraft_sysid_ros.fleet.page import require_jinja2, write_page
from aircraft_sysid_ros.fleet.priors import write_priors
from aircraft_sysid_ros.fleet.results import RUNS, Results
from aircraft_sysid_ros.fleet.tables import Flown, in_order, read_table, require_pyarrow, tables_of, write_tables
from aircraft_sysid_ros.flight_check.finding import ERROR
from aircraft_sysid_ros.identification.trust import Trust

#: What the process of a flight finds loaded.
_WORK = Work(answer_of, (), ("aircraft_sysid_ros.fleet.warm", "aircraft_sysid_ros.fleet.flight_task"))


@dataclass(frozen=True)
class Asked:
    """What a user asks of a fleet."""

    sources: Sequence[str]
    files: Files
    out: Path
    replicas: int
    time_limit: float  # [s] of one flight
    runs: bool = False
    scheduler: str | None = None
    workers: int | None = None


#: Names of flights that a note lists.
_MOST_NAMED = 5
_GIVE_START = "what changes from flight to flight rests on it; give `start` in a list of the flights"


@dataclass(frozen=True)
class Fleet:
    """All flights with their answers, and what was found between them."""

    out: Path
    flown: Sequence[Flown]
    between: Between
    new: int  # flights that were not known already
    notes: Sequence[str]

    @property
    def ok(self) -> int:
        """Flights that could be used."""
        return sum(flown.answer["ok"] for flown in self.flown)

    @property
    def losses(self) -> list[str]:
        """What could not be read of flights that were used, a sentence each."""
        return [f"{f.flight.name}: {loss}" for f in self.flown for loss in f.answer.get("losses", ())]

    @property
    def doubts(self) -> list[str]:
        """What makes the order of the flights uncertain, and what flights that were used have not given."""
        notes = []
        for airframe, group in itertools.groupby(self.flown, key=lambda f: f.flight.airframe):
            starts = Counter(f.start for f in group if f.answer["ok"])
            undated, alike = starts.pop(None, 0), [n for n in starts.values() if n > 1]
            if undated > 1 or (undated and starts):
                notes.append(
                    f"{undated} flights of {airframe} have no date: they come last, in the order of their names; "
                    f"{_GIVE_START}"
                )
            if alike:
                notes.append(
                    f"{sum(alike)} flights of {airframe} begin at the same time as another one: their order is that of "
                    f"their names; {_GIVE_START}"
                )
        silent = [f.flight.name for f in self.flown if f.answer["ok"] and not _is_used(f)]
        if silent:
            listed = ", ".join(silent[:_MOST_NAMED])
            more = f" and {len(silent) - _MOST_NAMED} more" if len(silent) > _MOST_NAMED else ""
            notes.append(f"{len(silent)} of {self.ok} flights gave no parameter to USE: {listed}{more}")
        return notes

    @property
    def errors(self) -> list[str]:
        """Errors that ``check`` found in flights that were used, a sentence each."""
        return [
            f"{f.flight.name}: {finding['signal']}: {finding['sentence']}"
            for f in self.flown
            for finding in f.answer.get("findings", ())
            if f.answer["ok"] and finding["severity"] == ERROR
        ]

    @property
    def faulty(self) -> list[dict[str, Any]]:
        """Flights in which ``diagnose`` found something, with what."""
        return [
            {"flight": f.flight.name, "verdict": found["verdict"], "effects": [c["label"] for c in found["candidates"]]}
            for f in self.flown
            if (found := f.answer.get("diagnosis")) and found["verdict"] != "none"
        ]

    @property
    def json(self) -> dict[str, Any]:
        """The content of ``fleet --json``."""
        failures = [{"flight": f.flight.name, "reason": f.answer["reason"]} for f in self.flown if not f.answer["ok"]]
        return {
            "flights": len(self.flown),
            "ok": self.ok,
            "new": self.new,
            "airframes": sorted({flown.flight.airframe for flown in self.flown}),
            "failures": failures,
            "changes": self.between.changes,
            "too_few": self.between.too_few,
            "differences": self.between.differences,
            "effects": self.between.effects,
            "verdicts": self.faulty,
            "false_discovery_rate": self.between.rate,
            "page": str(self.out / "fleet.html"),
            "notes": [*self.notes, *self.doubts, *self.losses, *self.errors],
        }


def _is_used(flown: Flown) -> bool:
    return any(p["status"] == Trust.USE.name for p in flown.answer.get("parameters", ()))


def fly_fleet(asked: Asked, tell: Callable[[str, int, int], None], say: Callable[[str], None]) -> Fleet:
    """Fly what is not known yet, and write tables and page. Raises InputError.

    ``tell`` hears what is done, and how many of how many flights; ``say`` what a user should know at once.
    """
    require_pyarrow()
    require_jinja2()
    flights = flights_of(asked.sources, asked.files, asked.out)
    if asked.runs:
        check_run_folders(flights)
    results = Results(asked.out)
    with results.held():
        answers, jobs = _jobs(flights, asked, tell)
        known = {name: found for name, job in jobs.items() if (found := results.known(job, asked.time_limit))}
        new = {name: job for name, job in jobs.items() if name not in known}
        answers |= known
        unkept: list[str] = []
        if new:
            answers |= _flown(new, asked, results, unkept, tell, say)
        flown = in_order([Flown(flight, answers[flight.name]) for flight in flights])
        tables = tables_of(flown)
        fleet = Fleet(asked.out, flown, between_flights(tables, flown), len(new), unkept)
        if not fleet.ok and _has_usable_flights(asked.out):
            why = "what its flights said before is worth more than nothing"
            return replace(fleet, notes=[*fleet.notes, f"{asked.out} is left as it was: {why}"])
        _write(fleet, tables)
    return fleet


def _has_usable_flights(out: Path) -> bool:
    """Whether the tables of a folder, where they are there and whole, rest on any flight."""
    try:
        return is_fleet(out) and any(row["ok"] for row in read_table(out / FLIGHTS))
    except InputError:
        return False


def _write(fleet: Fleet, tables: Mapping[str, Any]) -> None:
    """Tables, priors and page."""
    between = fleet.between
    write_tables(fleet.out, {**tables, "changes": between.changes, "airframes": between.airframes})
    write_priors(fleet.out, between.priors)
    write_page(fleet.out / "fleet.html", fleet.flown, between)


def _jobs(
    flights: Sequence[Flight], asked: Asked, tell: Callable[[str, int, int], None]
) -> tuple[dict[str, Answer], dict[str, Job]]:
    """Answers to flights that cannot be flown, and the jobs of the others, by name."""
    answers: dict[str, Answer] = {}
    jobs: dict[str, Job] = {}
    beside: dict[tuple[Path, ...], str] = {}  # keys of all that an answer rests on but the recording
    first: dict[str, str] = {}
    for count, flight in enumerate(flights):
        tell("check what is known already", count, len(flights))
        try:
            if not flight.recording.exists():
                raise InputError(f"there is no recording {flight.recording}")
            recording = content_key((flight.recording,))
            options = Options(asked.replicas, flight.map, flight.servos, flight.calm_air)
            files = (flight.aircraft, *options.files)
            if files not in beside:
                beside[files] = content_key((), program_key(), *map(_file_key, files))
        except (OSError, InputError) as error:
            why = f"cannot be read: {error.strerror}" if isinstance(error, OSError) else str(error)
            answers[flight.name] = _no_answer(why)
            continue
        other = first.setdefault(recording, flight.name)
        if other != flight.name:
            answers[flight.name] = _no_answer(f"it holds the same as {other}, and counts once")
            continue
        key = content_key((), recording, beside[files], repr((options.replicas, options.calm_air)))
        keep = (asked.out / RUNS / flight.name).absolute() if asked.runs else None
        jobs[flight.name] = Job(
            key, flight.recording, flight.is_log, flight.aircraft, options, program_key(), keep, program_place()
        )
    return answers, jobs


def _file_key(path: Path) -> str:
    """Key of a file beside a recording. Raises InputError."""
    try:
        return content_key((path,))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def _no_answer(reason: str) -> Answer:
    return {"ok": False, "reason": reason}


def _flown(
    jobs: Mapping[str, Job],
    asked: Asked,
    results: Results,
    unkept: list[str],
    tell: Callable[[str, int, int], None],
    say: Callable[[str], None],
) -> dict[str, Answer]:
    """Fly jobs on the cluster; answers by name, kept as they come."""
    answers: dict[str, Answer] = {}
    names = {job.key: name for name, job in jobs.items()}
    tell("start the cluster", 0, len(jobs))

    def done(job: Any, outcome: Mapping[str, Any] | Failed) -> None:
        if isinstance(outcome, Failed):
            answer, lasting = _no_answer(outcome.sentence), outcome.lasting
            if outcome.took_all_time:
                answer["time_limit"] = asked.time_limit
        else:
            answer, lasting = dict(outcome), True
        answers[names[job.key]] = answer
        tell("fly", len(answers), len(jobs))
        if lasting and not unkept:
            try:
                results.keep(job.key, answer)
            except OSError as error:
                unkept.append(
                    f"answers cannot be kept in {asked.out} ({error.strerror or error}): a fleet that is begun again "
                    "flies these flights again"
                )

    with cluster(asked.scheduler, asked.workers) as client:
        if has_dashboard() and client.dashboard_link:
            say(f"dashboard {client.dashboard_link}")
        if asked.scheduler and not client.nthreads():
            say(f"the scheduler has no workers yet: start some with `dask worker {shlex.quote(asked.scheduler)}`")
        try:
            fly_all(client, list(jobs.values()), _WORK, Limits(asked.time_limit), done)
        except KeyboardInterrupt:
            say(f"{len(answers)} of {len(jobs)} flights are done and kept; the same command continues with the others")
            raise
    return answers
