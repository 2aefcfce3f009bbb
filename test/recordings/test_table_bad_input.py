"""Tables and maps that are wrong: one sentence that says what to do, and nothing is written."""

from __future__ import annotations

import json
import shutil

import numpy as np
import openpyxl
import pytest
from scipy.io import savemat

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression
from aircraft_sysid_ros.recordings.tabular.column_map import parse_column_map
from aircraft_sysid_ros.recordings.tabular.units import conversion

MAP = """tables:
  - time: {column: Time, unit: s}
    signals:
      angular_velocity.x: {column: P, unit: deg/s}
      specific_force.z: {column: Nz, unit: g, sign: -1}
"""
ROWS = [f"{0.02 * i:.2f},{i % 7}.5,-1.0{i % 3}" for i in range(60)]


def table(*rows, header="Time,P,Nz"):
    return "\n".join([header, *rows]) + "\n"


def refused(tmp_path, capsys, name="flight.csv", text=MAP):
    """The one sentence with which an import is refused."""
    (tmp_path / "map.yaml").write_text(text)
    status = main(["import", str(tmp_path / name), "--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "bag")])
    said = capsys.readouterr()
    assert (status, said.out) == (2, "")
    assert said.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir() if path.name.startswith(("bag", ".bag"))) == []
    return said.err


BAD_TABLES = [
    (table(*ROWS, header="Time,RollRate,Nz"), "no column 'P'"),
    (table(*ROWS, header="Time,p ,Nz").replace("p ,", "p_,"), "did you mean 'p_'?"),
    (table(*ROWS, header="time_s,P,Nz"), "no column 'Time': did you mean 'time_s'?"),
    (table(*(f"{row},1" for row in ROWS), header="Time,P,Nz,Time"), "2 columns 'Time': rename all but one"),
    (table(*ROWS[:30], *ROWS[20:]), "goes back by 0.18 s at data row 31"),
    (table(), "one line and no data"),
    ("", "is empty"),
    ("\0\1\2" * 400, "is named as a text file, but holds no text; write it again"),
    (table(*ROWS).encode("utf-16-le").decode("latin-1"), "is named as a text file, but holds no text; write it again"),
    ("one,two\nthree,four\n", "holds no table"),
    (table(*(row.replace(",", ":00:00,", 1) for row in ROWS)), "for times as text write iso or irig"),
    (table(*(f"1{i:018d}000,1,1" for i in range(9))), "check its unit"),
    (table(*(f"{i},," for i in range(9))), "no values of the mapped columns"),
]


@pytest.mark.parametrize(("content", "sentence"), BAD_TABLES, ids=[sentence for _, sentence in BAD_TABLES])
def test_a_bad_table_is_refused_in_one_sentence(tmp_path, capsys, content, sentence):
    (tmp_path / "flight.csv").write_text(content)
    assert sentence in refused(tmp_path, capsys)


def test_numbers_that_nothing_has_are_said_and_not_measured(tmp_path, capsys, recwarn):
    """Of a damaged file, or of a column that is none: import took them, and check printed warnings of numpy."""
    rows = [*ROWS[:9], "0.18,1e300,-1e308", "0.20,-1e300,-1.0", *ROWS[11:]]
    (tmp_path / "flight.csv").write_text(table(*rows))
    (tmp_path / "map.yaml").write_text(MAP)
    command = ["import", str(tmp_path / "flight.csv"), "--map", str(tmp_path / "map.yaml"), "--out"]
    assert main([*command, str(tmp_path / "bag"), "--json"]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    wild = "flight.csv: {} of {} beyond 1e+09 {}, the largest {}, {} taken as not measured".format
    assert wild("2 values", "angular_velocity.x from P", "rad/s", "1.75e+298", "are") in notes
    assert wild("1 value", "specific_force.z from Nz", "m/s^2", "inf", "is") in notes
    fields = read_table(tmp_path / "bag", "imu/data").fields
    for values in (fields["angular_velocity"], fields["linear_acceleration"]):
        assert np.nanmax(np.abs(values)) < 20.0
    main(["check", str(tmp_path / "bag")])
    said = capsys.readouterr()
    assert "Warning" not in said.err and not any(issubclass(w.category, RuntimeWarning) for w in recwarn.list)


def test_a_column_that_is_not_there_names_signal_and_line(tmp_path, capsys):
    (tmp_path / "flight.csv").write_text(table(*ROWS, header="Time,P,NZ_cg"))
    said = refused(tmp_path, capsys)
    assert "specific_force.z in line 5" in said
    assert "did you mean 'NZ_cg'?" in said


def test_an_empty_sheet_and_files_of_another_kind(tmp_path, capsys):
    openpyxl.Workbook().save(tmp_path / "empty.xlsx")
    assert "its sheets (Sheet) are empty" in refused(tmp_path, capsys, "empty.xlsx")
    for name in ("fake.xlsx", "fake.parquet", "fake.h5", "fake.mat"):
        (tmp_path / name).write_text("no such format")
        assert "is not a readable" in refused(tmp_path, capsys, name)
    (tmp_path / "fake.csv.gz").write_text("not compressed")
    assert "cannot read" in refused(tmp_path, capsys, "fake.csv.gz")
    savemat(tmp_path / "lengths.mat", {"Time": range(9), "P": range(8), "Nz": range(9)})
    assert "differ in length" in refused(tmp_path, capsys, "lengths.mat")
    assert "there is no log" in refused(tmp_path, capsys, "nothing.csv")


def test_several_tables_need_a_name(tmp_path, capsys):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(table(*ROWS))
    said = refused(tmp_path, capsys, ".")
    assert "several tables (a.csv, b.csv): say with 'file'" in said
    said = refused(tmp_path, capsys, ".", MAP.replace("- time", "- file: c*.csv\n    time"))
    assert "has no file 'c*.csv'" in said
    said = refused(tmp_path, capsys, ".", MAP.replace("- time", "- file: '*.csv'\n    time"))
    assert "begins 1.18 s before a.csv ends: map them as two tables" in said


BAD_MAPS = [
    ("specific_force.z", "specific_force.w", "line 5: unknown signal 'specific_force.w': did you mean"),
    ("specific_force.z", "inputs.sin", "line 5: 'inputs.sin' has a name that terms of a model use otherwise"),
    ("specific_force.z", "inputs.V", "line 5: 'inputs.V' has a name that terms of a model use otherwise"),
    (
        "specific_force.z",
        "inputs.höhe",
        "line 5: 'inputs.höhe' is not a name for an input: write letters, digits and _",
    ),
    ("unit: g", "unit: deg", "line 5: specific_force.z: the unit 'deg' does not fit: this is in m/s^2, or g, ft/s^2"),
    ("unit: g", "unit: gg", "line 5: specific_force.z: 'gg' is not a unit"),
    ("unit: deg/s", "unit: Hz", "line 4: angular_velocity.x: the unit 'Hz' does not fit"),
    ("unit: deg/s", "unit: 9**9**9**9", "is not a unit"),
    ("sign: -1", "sign: 0.5", "must be 1 or -1"),
    ("sign: -1", "sing: -1", "line 5: unknown key 'sing' of specific_force.z: did you mean 'sign'?"),
    ("specific_force.z", "angular_velocity.x", "is there twice, first in line 4"),
    ("{column: Time, unit: s}", "{column: Time, column: T, unit: s}", "the key 'column' is there twice"),
    ("{column: Time, unit: s}", "[{column: Time, unit: s}, {column: T, unit: s}]", "one time column"),
    ("{column: Time, unit: s}", "{column: Time, unit: m}", "line 2: time: the unit 'm' does not fit"),
    ("{column: Time, unit: s}", "{column: Time}", "the key 'unit' is missing"),
    ("column: P", "expression: 'P +'", "is not an expression"),
    ("column: P", "expression: '__import__(P)'", "is not allowed"),
    ("column: P", "expression: 'P.__class__.mro()'", "is not allowed"),
    ("column: P", "colum: P", "did you mean 'column'?"),
    ("tables:", "clock: tai\ntables:", "line 1: clock 'tai' is not known: write utc, gps"),
    ("tables:", "table:", "did you mean 'tables'?"),
    (MAP, "", "it is empty"),
    (MAP, "tables: [", "it is not valid YAML"),
    (MAP, "[" * 2000, "it is not valid YAML"),
]


@pytest.mark.long_after_the_first
@pytest.mark.parametrize(("now", "then", "sentence"), BAD_MAPS, ids=[sentence for *_, sentence in BAD_MAPS])
def test_a_bad_map_is_refused_with_the_line(now, then, sentence):
    assert now in MAP
    with pytest.raises(InputError) as refused:
        parse_column_map(MAP.replace(now, then))
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("unit", "si_unit", "number", "value"),
    [
        ("°C", "K", 15.0, 288.15),
        ("degF", "K", 59.0, 288.15),
        ("inHg", "Pa", 29.9213, 101325.0),
        ("kts", "m/s", 100.0, 51.4444),
        ("g", "m/s^2", 1.0, 9.80665),
        ("g", "kg", 1500.0, 1.5),
        ("1e-7 deg", "rad", 450_000_000, 0.785398),
        ("%", "1", 55.0, 0.55),
        ("rpm", "rad/s", 6000.0, 628.3185),
        ("ft/min", "m/s", 500.0, 2.54),
        ("slug/ft3", "kg/m^3", 0.0023769, 1.225),
    ],
)
def test_units_convert(unit, si_unit, number, value):
    assert conversion(unit, si_unit)(number) == pytest.approx(value, rel=2e-5)


def test_an_expression_of_columns():
    found = parse_column_expression("sqrt(2*Qc/`Rho [kg]`) + xyz[2] - a.b/2")
    assert found.columns == ("Qc", "Rho [kg]", "xyz[2]", "a.b")
    value = found.evaluate({"Qc": [8.0, -1.0], "Rho [kg]": [1.0, 1.0], "xyz[2]": [1.0, 1.0], "a.b": [2.0, 2.0]})
    assert value[0] == 4.0
    assert value[1] != value[1]  # a root of a negative number is not there


def test_what_is_no_measurement_is_left_out_and_counted(tmp_path, capsys):
    rows = [ROWS[0], ROWS[0], ",1,1", *ROWS[1:]]
    rows[10] = rows[10].replace(",-1", ",broken-1")
    (tmp_path / "flight.csv").write_text(table(*rows) + "1.5,2")
    (tmp_path / "map.yaml").write_text(MAP)
    arguments = [
        "import",
        str(tmp_path / "flight.csv"),
        "--map",
        str(tmp_path / "map.yaml"),
        "--out",
        str(tmp_path / "b"),
    ]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "flight.csv: 1 cell is not a number and left out" in said
    assert "flight.csv: 1 row without a time left out" in said
    assert "flight.csv: 1 row with the time of the row before left out" in said
    assert "imu/data: without specific_force.x, specific_force.y" in said  # never silently


@pytest.mark.parametrize("made_of", ["column: Words", 'expression: "P/0"', 'expression: "sqrt(-1 - P**2)"'])
def test_one_axis_without_any_number_is_said(tmp_path, capsys, made_of):
    (tmp_path / "flight.csv").write_text(table(*(f"{row},n/a" for row in ROWS), header="Time,P,Nz,Words"))
    (tmp_path / "map.yaml").write_text(f"{MAP}      specific_force.x: {{{made_of}, unit: g}}\n")
    assert (
        main(
            ["import", str(tmp_path / "flight.csv"), "--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "b")]
        )
        == 0
    )
    said = capsys.readouterr().out
    assert "note: specific_force.x: what it is mapped to holds no number: check that line" in said
    assert "specific_force.z: what" not in said


def test_a_table_without_a_map_is_told_the_way(tmp_path, capsys):
    (tmp_path / "flight.csv").write_text(table(*ROWS))
    assert main(["import", str(tmp_path / "flight.csv"), "--out", str(tmp_path / "bag")]) == 2
    way = f"tables need --map MAP.yaml, which `aircraft-sysid import {tmp_path / 'flight.csv'} --guess MAP.yaml` begins"
    assert way in capsys.readouterr().err
    assert main(["import", str(tmp_path / "flight.csv")]) == 2
    assert "give with --out" in capsys.readouterr().err


def imported_notes(tmp_path, capsys, content):
    """The notes of an import, and how many samples of the IMU it has."""
    (tmp_path / "flight.csv").write_bytes(content)
    (tmp_path / "map.yaml").write_text(MAP)
    command = ["import", str(tmp_path / "flight.csv"), "--map", str(tmp_path / "map.yaml"), "--out"]
    assert main([*command, str(tmp_path / "bag"), "--json"]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    return notes, len(read_table(tmp_path / "bag", "imu/data").stamp)


def test_one_bad_cell_takes_no_others_also_with_decimal_commas(tmp_path, capsys):
    """It took its column, of which pandas made texts; in that of the time it ended the import."""
    rows = [row.replace(",", ";").replace(".", ",") for row in ROWS]
    rows[29] = "0,58;ERR;-1,02"
    notes, count = imported_notes(tmp_path, capsys, table(*rows, header="Time;P;Nz").encode())
    assert "flight.csv: 1 cell is not a number and left out" in notes and count == 59
    rates = read_table(tmp_path / "bag", "imu/data").fields["angular_velocity"][:, 0]
    np.testing.assert_allclose(np.degrees(rates), [i % 7 + 0.5 for i in range(60) if i != 29])
    shutil.rmtree(tmp_path / "bag")
    (tmp_path / "flight.csv").write_text(table(*rows[:40], "late;1,5;-1,0", header="Time;P;Nz"))
    assert "holds 'late', which is not a number" in refused(tmp_path, capsys)


def test_rows_with_cells_too_many_are_said(tmp_path, capsys):
    rows = [*ROWS[:9], "0.18,3,5,-1.00", "0.20,3.5,-1.0,7,8,9", *(f"{row}," for row in ROWS[11:])]
    notes, count = imported_notes(tmp_path, capsys, table(*rows).encode())
    (said,) = [note for note in notes if "more cells" in note]
    assert said.startswith("flight.csv: 2 rows have more cells than the table has columns, the first is data row 10: ")
    assert count == 60


def test_rows_with_no_cells_too_many_are_not(tmp_path, capsys):
    """A separator at the end of each row is a habit of some programs."""
    notes, _ = imported_notes(tmp_path, capsys, table(*(f"{row}," for row in ROWS), header="Time,P,Nz,").encode())
    assert not any("more cells" in note for note in notes)


@pytest.mark.parametrize("place", [5, 30, 60])
def test_zero_bytes_of_a_recorder_that_lost_its_power_cost_their_row(tmp_path, capsys, place):
    rows = [*ROWS[:place], "\0" * 4096, *ROWS[place:]]
    notes, count = imported_notes(tmp_path, capsys, table(*rows).encode())
    assert "flight.csv: 1 row without a time left out" in notes
    assert count == 60


@pytest.mark.parametrize("cut", ["1.20", "1.2", "1.20,4", "1.20,4.5,"])
def test_a_last_line_that_breaks_off_is_left_out_and_said(tmp_path, capsys, cut):
    """Half a time went back by minutes, with the advice to sort the rows; half an airspeed of 75 was one of 7."""
    content = table(*ROWS).encode() + cut.encode()
    notes, count = imported_notes(tmp_path, capsys, content)
    breaks_off = "flight.csv: it breaks off in the middle of its last line, which is left out"
    assert (breaks_off in notes) == (cut.count(",") < 2)
    assert count == 60 + (breaks_off not in notes)


@pytest.mark.parametrize("end", ["", "\n", "\r\n"])
def test_a_last_line_that_is_whole_is_taken_with_and_without_its_end(tmp_path, capsys, end):
    notes, count = imported_notes(tmp_path, capsys, table(*ROWS).encode().strip() + end.encode())
    assert count == 60 and not any("breaks off" in note for note in notes)
