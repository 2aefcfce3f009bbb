"""The tables of a fleet as Parquet files, one row group per airframe: pandas, Polars and DuckDB read them.

The rows depend on the flights and their answers alone, and so does every byte of the files with one version of pyarrow.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.flight_task import Answer
from aircraft_sysid_ros.fleet.flights import Flight
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.recordings.autopilot_log import NO_DATE
from aircraft_sysid_ros.recordings.raw_messages import printable
from aircraft_sysid_ros.stamps import NANOSECONDS

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]
#: Stamps [ns] up to two days after what a log without a date is stamped from are of a clock that was not set.
_NO_DATE = (NO_DATE + 2 * 86_400) * NANOSECONDS
#: Columns of the tables by name, with their types in pyarrow.
_FLIGHT = {"flight": "string", "airframe": "string", "start": "time"}
COLUMNS: dict[str, dict[str, str]] = {
    "flights": {**_FLIGHT, "ok": "bool", "reason": "string", "duration": "double", "recording": "string"},
    "parameters": {
        **_FLIGHT, "parameter": "string", "value": "double", "std": "double", "status": "string", "V": "double",
        "alpha": "double",
    },
    "sensors": {**_FLIGHT, "sensor": "string", "value": "double", "std": "double", "status": "string"},
    "verdicts": {
        "flight": "string", "verdict": "string", "effect": "string", "axes": "string", "p_value": "double",
        "error_before": "double", "error_after": "double", "airframe": "string", "start": "time", "label": "string",
    },
    "errors": {
        **_FLIGHT, "axis": "string", "nrmse_fit": "double", "nrmse_held_out": "double", "noise_floor": "double",
        "white": "bool",
    },
    "findings": {**_FLIGHT, "signal": "string", "kind": "string", "severity": "string", "sentence": "string"},
    "changes": {
        "airframe": "string", "parameter": "string", "kind": "string", "when": "time", "size": "double",
        "std": "double", "p_value": "double", "flight": "string", "flights": "int64", "per_hour": "double",
    },
    "airframes": {
        "airframe": "string", "parameter": "string", "flights": "int64", "value": "double", "std": "double",
        "between_flights": "double", "others": "double", "others_std": "double", "p_value": "double",
        "differs": "bool",
    },
}  # fmt: skip


@dataclass(frozen=True)
class Flown:
    """A flight with its answer."""

    flight: Flight
    answer: Answer

    @property
    def start(self) -> int | None:
        """When it began [ns] UTC: what the list says, or the recording; None where nothing says so.

        A clock that nobody set counts from 1970, and a table without a date from 2000.
        """
        if self.flight.start is not None:
            return self.flight.start
        recorded = self.answer.get("start")
        return None if recorded is None or recorded < _NO_DATE else recorded

    @property
    def head(self) -> Row:
        """What begins its rows."""
        return {"flight": self.flight.name, "airframe": self.flight.airframe, "start": self.start}


def in_order(flown: Sequence[Flown]) -> list[Flown]:
    """Flights by airframe and time, and by name where that is the same: f10 after f9; without a time they come last."""
    return sorted(flown, key=lambda f: (f.flight.airframe, f.start is None, f.start or 0, _by_numbers(f.flight.name)))


def _by_numbers(name: str) -> list[tuple[str, int]]:
    """What orders names by the numbers in them."""
    parts = re.split(r"([0-9]+)", name)
    return [(text, int(number or 0)) for text, number in itertools.zip_longest(parts[::2], parts[1::2])]


def tables_of(flown: Sequence[Flown]) -> dict[str, list[Row]]:
    """Rows of what was found in each flight, by table."""
    makers = {"flights": _flight, "parameters": _parameters, "verdicts": _verdicts, "errors": _errors}
    makers |= {"findings": _findings, "sensors": _sensors}
    return {name: [row for each in in_order(flown) for row in make(each)] for name, make in makers.items()}


def _flight(flown: Flown) -> Iterator[Row]:
    answer = flown.answer
    said = {"ok": answer["ok"], "reason": answer["reason"], "duration": answer.get("duration")}
    yield {**flown.head, **said, "recording": printable(str(flown.flight.recording))}


def _parameters(flown: Flown) -> Iterator[Row]:
    for p in flown.answer.get("parameters", ()):
        yield {**flown.head, "parameter": p["name"], **p}


def _sensors(flown: Flown) -> Iterator[Row]:
    for sensor in flown.answer.get("sensors", ()):
        yield {**flown.head, "sensor": sensor["name"], **sensor}


def _verdicts(flown: Flown) -> Iterator[Row]:
    found = flown.answer.get("diagnosis")
    if not found:
        return
    for candidate in found["candidates"] or [{"axes": []}]:
        yield {**flown.head, "verdict": found["verdict"], **candidate, "axes": " ".join(candidate["axes"])}


def _errors(flown: Flown) -> Iterator[Row]:
    for axis, found in flown.answer.get("axes", {}).items():
        yield {**flown.head, "axis": axis, **found}


def _findings(flown: Flown) -> Iterator[Row]:
    for finding in flown.answer.get("findings", ()):
        yield {**flown.head, **finding}


# -- files ---------------------------------------------------------------------------------------------------


def require_pyarrow() -> None:
    """Raises MissingExtra where tables cannot be written, before the work."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise MissingExtra("fleets", "pyarrow", "fleet") from None


def write_tables(out: Path, tables: Mapping[str, Sequence[Row]]) -> list[Path]:
    """Write ``NAME.parquet`` of every table, each whole. Raises InputError."""
    written = []
    for name, rows in tables.items():
        path = out / f"{name}.parquet"
        part = path.with_name(f".{path.name}.part")
        try:
            _write(part, COLUMNS[name], rows)
            part.replace(path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise InputError(
                f"cannot write {path}: {error.strerror or error}; what was found is kept, make room and begin again"
            ) from None
        written.append(path)
    return written


def read_table(path: Path) -> list[Row]:
    """The rows of one of these files, times in ns. Raises InputError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
        for k, field in enumerate(table.schema):
            if pa.types.is_timestamp(field.type):  # as times they would need pandas
                table = table.set_column(k, field.name, table[field.name].cast(pa.int64()))
        rows: list[Row] = table.to_pylist()
    except (OSError, ValueError) as error:  # those of pyarrow are both
        raise InputError(f"cannot read {path}: {error}") from None
    return rows


def _write(path: Path, columns: Mapping[str, str], rows: Sequence[Row]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    types: dict[str, pa.DataType] = {
        "string": pa.string(), "double": pa.float64(), "bool": pa.bool_(), "int64": pa.int64(),
        "time": pa.timestamp("ns", tz="UTC"),
    }  # fmt: skip
    schema = pa.schema([(name, types[kind]) for name, kind in columns.items()])
    with pq.ParquetWriter(path, schema) as writer:
        if not rows:
            writer.write_table(schema.empty_table())
        for _, group in itertools.groupby(rows, key=lambda row: row["airframe"]):
            writer.write_table(_table(list(group), columns, schema))


def _table(rows: Sequence[Row], columns: Mapping[str, str], schema: pa.Schema) -> pa.Table:
    """Rows as a table: numbers that are not known are NaN, other things null."""
    import pyarrow as pa

    arrays = []
    for name, kind in columns.items():
        values = [row.get(name) for row in rows]
        if kind == "double":
            values = [float("nan") if value is None else value for value in values]
        arrays.append(pa.array(values, schema.field(name).type))
    return pa.Table.from_arrays(arrays, schema=schema)
