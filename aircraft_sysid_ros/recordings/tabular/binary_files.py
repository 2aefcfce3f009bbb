"""Tables in Parquet, HDF5, MAT (5 and 7.3) and Excel files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.archives import is_bomb
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.mat_file import read_mat
from aircraft_sysid_ros.recordings.tabular.header import find_header
from aircraft_sysid_ros.recordings.tabular.table import ArrayTable, Table, imported
from aircraft_sysid_ros.recordings.tabular.text_files import names_beside
from aircraft_sysid_ros.recordings.tabular.units import is_unit

_VECTOR, _MOST_COMPONENTS, _LEAST_OF_SIDPAC = 4, 64, 30
#: Fields of a structure that is one column: its values, and their unit.
_VALUES, _UNITS = ("data", "value", "values"), ("units", "unit")
#: Columns, counted from 1, of the matrix ``fdata`` of SIDPAC (Klein and Morelli, Aircraft System Identification), each
#: with its unit.
_SIDPAC = {
    1: ("time", "s"), 2: ("vt", "ft/s"), 3: ("beta", "deg"), 4: ("alpha", "deg"), 5: ("p", "deg/s"), 6: ("q", "deg/s"),
    7: ("r", "deg/s"), 8: ("phi", "deg"), 9: ("the", "deg"), 10: ("psi", "deg"), 11: ("ax", "g"), 12: ("ay", "g"),
    13: ("az", "g"), 14: ("elevator", "deg"), 15: ("aileron", "deg"), 16: ("rudder", "deg"), 27: ("qbar", "psf"),
    28: ("mach", "1"), 29: ("rho", "slug/ft^3"), 30: ("altitude", "ft"), 34: ("throttle", "1"), 38: ("thrust", "lbf"),
    48: ("mass", "slug"),
}  # fmt: skip
_HEADER_ROWS = 60  # of a sheet, within which its data must begin
HDF5_START = b"\x89HDF\r\n\x1a\n"


def parquet_tables(path: Path, name: str) -> tuple[str, list[Table]]:
    """The table of a Parquet file; raises InputError."""
    parquet = imported("pyarrow.parquet")
    try:
        schema = parquet.ParquetFile(path).schema_arrow
    except Exception as error:  # pyarrow has errors of its own
        raise InputError(f"{path} is not a readable Parquet file ({_one_line(error)})") from None
    units = {
        field.name: (field.metadata or {}).get(b"unit", b"").decode("utf8", "replace")
        for field in schema
        if (field.metadata or {}).get(b"unit")
    }
    return "Parquet", [ParquetTable(name, tuple(schema.names), units, path=path)]


@dataclass(frozen=True)
class ParquetTable(Table):
    """A Parquet file, read by batches."""

    path: Path = Path()

    def pieces(self, positions: Sequence[int], rows: int) -> Iterator[list[npt.NDArray[Any]]]:
        """See Table."""
        parquet = imported("pyarrow.parquet")
        names = [self.columns[i] for i in positions]
        try:
            for batch in parquet.ParquetFile(self.path).iter_batches(
                batch_size=rows, columns=list(dict.fromkeys(names))
            ):
                yield [batch.column(name).to_numpy(zero_copy_only=False) for name in names]
        except Exception as error:
            raise InputError(f"{self.path} cannot be read ({_one_line(error)})") from None


def hdf5_tables(path: Path, name: str) -> tuple[str, list[Table]]:
    """A table for every group of an HDF5 or MAT 7.3 file that has columns; raises InputError."""
    h5py = imported("h5py")
    tables: list[Table] = []
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise InputError(f"{path} is not a readable HDF5 file ({_one_line(error)})") from None
    is_matlab = any("MATLAB_class" in item.attrs for item in file.values())

    def visit(group: Any, title: str) -> None:
        columns: dict[str, Any] = {}
        units: dict[str, str] = {}
        for key, item in group.items():
            if key.startswith("#"):
                continue
            if isinstance(item, h5py.Group):
                if channel := _hdf5_channel(item):
                    found = _components(key, channel[0], transposed=is_matlab)
                    columns.update(found)
                    units.update(dict.fromkeys(found, channel[1]))
                else:
                    visit(item, f"{title}/{key}" if title else key)
            elif _is_char(item):
                continue
            elif item.dtype.names:  # a compound data set is a table of its own
                fields = {field: _Field(item, field) for field in item.dtype.names if item.dtype[field].kind in "fiu"}
                tables.append(
                    ArrayTable(f"{title}/{key}" if title else key, tuple(fields), {}, arrays=tuple(fields.values()))
                )
            elif item.dtype.kind in "fiu" and item.ndim in (1, 2):
                found = _components(key, item, transposed=is_matlab)
                columns.update(found)
                unit = item.attrs.get("unit", item.attrs.get("units", ""))
                text = unit.decode("utf8", "replace") if isinstance(unit, bytes) else str(unit)
                units.update(dict.fromkeys(found, text) if text else {})
        if columns:
            tables.append(ArrayTable(title or name, tuple(columns), _said(units), arrays=tuple(columns.values())))

    visit(file, "")
    if not tables:
        raise InputError(f"{path} holds no columns of numbers")
    return "MAT 7.3" if is_matlab else "HDF5", tables


@dataclass(frozen=True)
class _Field:
    """A field of a compound data set."""

    data: Any
    name: str

    def __len__(self) -> int:
        return int(self.data.shape[0])

    def __getitem__(self, rows: slice) -> Any:
        return self.data[rows][self.name]


@dataclass(frozen=True)
class _Component:
    """A column of a two-dimensional data set, ``along`` which its rows run."""

    data: Any
    index: int
    along: int

    def __len__(self) -> int:
        return int(self.data.shape[self.along])

    def __getitem__(self, rows: slice) -> Any:
        return self.data[rows, self.index] if self.along == 0 else self.data[self.index, rows]


def _components(name: str, data: Any, *, transposed: bool = False) -> dict[str, Any]:
    """Columns of an array: itself, or name[0], name[1] … of (n, k); nothing of what is no series."""
    if data.ndim == 1:
        return {name: data} if len(data) > 1 else {}
    if data.ndim != 2 or max(data.shape) < 2:
        return {}
    rows, columns = data.shape
    along = 1 if transposed else 0
    if 1 in data.shape:
        along = int(np.argmax(data.shape))
    elif (columns > rows) != transposed and min(data.shape) <= _MOST_COMPONENTS < max(data.shape):
        along = 1 - along  # a series of vectors that was stored on its side
    count = data.shape[1 - along]
    if count > _MOST_COMPONENTS:
        return {}
    if count == 1:
        return {name: _Component(data, 0, along)}
    return {f"{name}[{i}]": _Component(data, i, along) for i in range(count)}


def mat_tables(path: Path, name: str) -> tuple[str, list[Table]]:
    """Structures and vectors of a MAT file; raises InputError."""
    with path.open("rb") as file:
        start = file.read(520)
    if start.startswith(HDF5_START) or start[512:520] == HDF5_START or b"MATLAB 7.3" in start[:128]:
        return hdf5_tables(path, name)
    content = read_mat(path)
    tables: list[Table] = []
    _add_structure(tables, {key: value for key, value in content.items() if not key.startswith("__")}, "", name, path)
    if not tables:
        opaque = any(type(value).__name__ == "MatlabOpaque" for value in content.values())
        hint = ": save a MATLAB table as table2struct(T, 'ToScalar', true)" if opaque else ""
        raise InputError(f"{path} holds no columns of numbers{hint}")
    return "MAT 5", tables


def _add_structure(tables: list[Table], content: Mapping[str, Any], title: str, name: str, path: Path) -> None:
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    for key, value in content.items():
        inner = f"{title}/{key}" if title else key
        if channel := _mat_channel(value):
            found = _components(key, channel[0])
            columns.update(found)
            units.update(dict.fromkeys(found, channel[1]))
        elif _is_of_simulink(value):
            tables.append(_of_simulink(inner, value))
        elif hasattr(value, "_fieldnames"):
            _add_structure(tables, {field: getattr(value, field) for field in value._fieldnames}, inner, name, path)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
            labels = _labels(content, key, value)
            if labels:
                tables.append(ArrayTable(inner, tuple(labels), {}, arrays=tuple(value.T)))
            elif key == "fdata" and value.ndim == 2 and value.shape[1] >= _LEAST_OF_SIDPAC:
                tables.append(_of_sidpac(inner, value))
            elif listed := _listed_beside(path, value):
                note = f"the columns of {inner} are named by {listed[0]}"
                tables.append(ArrayTable(inner, *listed[1:], note, arrays=tuple(value.T)))
            else:
                columns.update(_components(key, value))
    if columns:
        tables.append(ArrayTable(title or name, tuple(columns), _said(units), arrays=tuple(columns.values())))


def _listed_beside(path: Path, value: npt.NDArray[Any]) -> tuple[str, tuple[str, ...], dict[str, str]] | None:
    """File, names and units of a list beside the file of a matrix (n, k) of more columns than a vector has."""
    is_table = value.ndim == 2 and _VECTOR < value.shape[1] < value.shape[0]
    return names_beside(path, value.shape[1]) if is_table else None


def _mat_channel(value: Any) -> tuple[npt.NDArray[Any], str] | None:
    """Values and unit of a structure that is one column; None for what is none."""
    names = getattr(value, "_fieldnames", ())
    values = next((getattr(value, name) for name in names if name.lower() in _VALUES), None)
    unit = next((getattr(value, name) for name in names if name.lower() in _UNITS), None)
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu" or unit is None:
        return None
    unit = unit.item() if isinstance(unit, np.ndarray) and unit.size == 1 else unit
    return values, unit if isinstance(unit, str) else ""


def _hdf5_channel(group: Any) -> tuple[Any, str] | None:
    """The same of a group."""
    parts = {key.lower(): key for key in group}
    values = next((group[parts[name]] for name in _VALUES if name in parts), None)
    unit = next((group[parts[name]] for name in _UNITS if name in parts), None)
    if unit is None or getattr(getattr(values, "dtype", None), "kind", "") not in "fiu":
        return None
    return values, _char_text(unit)


def _is_char(item: Any) -> bool:
    """Whether a data set of a MAT 7.3 file is a text."""
    return bytes(item.attrs.get("MATLAB_class", b"")) == b"char"


def _char_text(item: Any) -> str:
    """The text of a data set, in MAT 7.3 as numbers of characters; "" for anything else."""
    if getattr(item, "shape", None) is None:
        return ""
    if _is_char(item):
        return "".join(chr(number) for number in np.ravel(item[()]).tolist())
    value = np.ravel(item[()])[0] if item.size == 1 else ""
    return value.decode("utf8", "replace") if isinstance(value, bytes) else value if isinstance(value, str) else ""


def _said(units: Mapping[str, str]) -> dict[str, str]:
    """Units that say one: "no unit" does not."""
    return {name: unit for name, unit in units.items() if unit.strip() and is_unit(unit)}


def _labels(content: Mapping[str, Any], key: str, value: npt.NDArray[Any]) -> list[str]:
    """Names of the columns of a matrix from the variable beside it that is called so."""
    for ending in ("_label", "_labels", "_names", "_columns"):
        labels = np.atleast_1d(content.get(key + ending, ()))
        if value.ndim == 2 and labels.dtype.kind in "UO" and len(labels) == value.shape[1]:
            return [str(label).strip() for label in labels]
    return []


def _is_of_simulink(value: Any) -> bool:
    """Whether a block of Simulink logged it as a structure with time, and no other structure has such fields."""
    signals: Any = getattr(value, "signals", None)
    return hasattr(value, "time") and all(hasattr(signal, "values") for signal in np.atleast_1d(signals))


def _of_simulink(title: str, logged: Any) -> ArrayTable:
    """What it logged: the columns of each signal, called by its label where no other one has that."""
    time = np.asarray(logged.time, dtype=np.float64).ravel()
    columns: dict[str, Any] = {"time": time} if len(time) else {}
    for number, signal in enumerate(np.atleast_1d(logged.signals), 1):
        said = getattr(signal, "label", "")
        label = said.strip() if isinstance(said, str) and said.strip() else f"signal {number}"
        if isinstance(signal.values, np.ndarray) and signal.values.dtype.kind in "fiub":
            found = _components(label, signal.values)
            columns |= (
                found if columns.keys().isdisjoint(found) else _components(f"{label} of signal {number}", signal.values)
            )
    return ArrayTable(title, tuple(columns), {"time": "s"}, arrays=tuple(columns.values()))


def _of_sidpac(title: str, fdata: npt.NDArray[Any]) -> ArrayTable:
    """The matrix (n, k) of SIDPAC without the columns that hold nothing, which are zero there."""
    columns = {i: fdata[:, i - 1] for i in range(1, fdata.shape[1] + 1) if fdata[:, i - 1].any()}
    names = {i: _SIDPAC.get(i, (f"fdata(:,{i})", ""))[0] for i in columns}
    units = {names[i]: _SIDPAC[i][1] for i in columns if i in _SIDPAC}
    note = f"the columns of {title} are named as SIDPAC has them"
    return ArrayTable(title, tuple(names.values()), units, note, arrays=tuple(columns.values()))


def excel_tables(path: Path, name: str) -> tuple[str, list[Table]]:
    """A table for every sheet with data; raises InputError."""
    openpyxl = imported("openpyxl")
    try:
        if is_bomb(path):
            raise ValueError("it announces more than its size can hold")
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    except Exception as error:  # zipfile, KeyError, its own
        raise InputError(
            f"{path} is not a readable Excel file ({_one_line(error)}): .xls must be saved as .xlsx"
        ) from None
    tables: list[Table] = []
    for sheet in book.worksheets:
        rows = [[_cell_text(cell) for cell in row] for row in sheet.iter_rows(max_row=_HEADER_ROWS, values_only=True)]
        width = Counter(len(row) for row in rows).most_common(1)[0][0] if rows else 0
        header = find_header([row[:width] + [""] * (width - len(row)) for row in rows])
        if header is not None:
            tables.append(ExcelTable(sheet.title, header.names, header.units, path=path, first_row=header.first_row))
    titles = ", ".join(sheet.title for sheet in book.worksheets)
    book.close()
    if not tables:
        raise InputError(f"{path} holds no table: its sheets ({titles}) are empty, or have no rows of numbers")
    return "Excel", tables


@dataclass(frozen=True)
class ExcelTable(Table):
    """A sheet, read row by row."""

    path: Path = Path()
    first_row: int = 0

    def pieces(self, positions: Sequence[int], rows: int) -> Iterator[list[npt.NDArray[Any]]]:
        """See Table."""
        book = imported("openpyxl").load_workbook(self.path, read_only=True, data_only=True)
        try:
            found: list[list[Any]] = []
            for row in book[self.name.split("/", 1)[-1]].iter_rows(min_row=self.first_row + 1, values_only=True):
                found.append([row[i] if i < len(row) else None for i in positions])
                if len(found) >= rows:
                    yield _object_columns(found)
                    found = []
            if found:
                yield _object_columns(found)
        finally:
            book.close()


def _object_columns(rows: list[list[Any]]) -> list[npt.NDArray[Any]]:
    columns = []
    for values in zip(*rows, strict=True):
        column = np.empty(len(values), dtype=object)
        column[:] = values
        columns.append(column)
    return columns


def _cell_text(value: Any) -> str:
    return "" if value is None else str(value).strip()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
