"""One simulated flight as strangers write it down: each function makes one layout and returns its MAP."""

from __future__ import annotations

import csv
from datetime import datetime, timedelta, timezone

import h5py
import numpy as np
import openpyxl
import pyarrow
import pyarrow.parquet

from aircraft_sysid_ros.ros_messages.conversion import ned_from_enu

KNOT, FOOT, GRAVITY = 1852.0 / 3600.0, 0.3048, 9.80665
FLU = np.array([1.0, -1.0, -1.0])
AXES = "xyz"


class Flown:
    """The first seconds of a flight by topic: stamps [ns] and columns in SI, FRD and NED."""

    def __init__(self, flight, seconds=12.0):
        streams = {stream.topic: stream for stream in flight.streams}
        end = streams["imu/data"].stamp[0] + int(seconds * 1e9)
        cut = {name: stream.stamp < end for name, stream in streams.items()}
        self.stamp = {name: stream.stamp[cut[name]] for name, stream in streams.items()}

        def of(topic, field):
            return np.asarray(streams[topic].fields[field], dtype=float)[cut[topic]]

        self.force = of("imu/data", "linear_acceleration") * FLU
        self.rate = of("imu/data", "angular_velocity") * FLU
        self.place = np.stack(
            [of("gps/fix", name) for name in ("latitude", "longitude", "altitude")], axis=1
        )  # degrees
        self.velocity = ned_from_enu(of("gps/vel", "twist.linear"))
        self.air = {
            name: of("air_data", name)
            for name in ("true_airspeed", "angle_of_attack", "sideslip", "static_pressure", "air_density")
        }
        self.controls = {
            name: of("control_surfaces", name)
            for name in ("elevator", "aileron", "rudder", "flaps", "throttle", "thrust", "propeller_speed")
        }

    def on_one_grid(self, held):
        """All columns on the union of all stamps, blank (or held) where a sensor has no sample."""
        stamp = np.unique(np.concatenate(list(self.stamp.values())))
        groups = {
            "imu/data": {
                **{f"f{a}": self.force[:, i] for i, a in enumerate(AXES)},
                **{f"w{a}": self.rate[:, i] for i, a in enumerate(AXES)},
            },
            "gps/fix": {name: self.place[:, i] for i, name in enumerate(("lat", "lon", "alt"))},
            "gps/vel": {name: self.velocity[:, i] for i, name in enumerate(("vn", "ve", "vd"))},
            "air_data": self.air,
            "control_surfaces": self.controls,
        }
        columns = {}
        for topic, group in groups.items():
            rows = np.searchsorted(stamp, self.stamp[topic])
            last = np.searchsorted(self.stamp[topic], stamp, side="right") - 1
            for name, values in group.items():
                column = np.full(len(stamp), np.nan)
                if held:
                    column = np.where(last >= 0, values[np.maximum(last, 0)], np.nan)
                else:
                    column[rows] = values
                columns[name] = column
        return stamp, columns


def write_rows(path, header, columns, *, delimiter=",", above=(), after=(), blank="", decimal="."):
    """A text of columns; numbers with twelve digits, NaN as ``blank``."""

    def text(value):
        if isinstance(value, str):
            return value
        if isinstance(value, (int, np.integer)):
            return str(value)
        return blank if np.isnan(value) else f"{value:.12g}".replace(".", decimal)

    with path.open("w", newline="", encoding="utf8") as file:
        file.write("".join(f"{line}\n" for line in above))
        writer = csv.writer(file, delimiter=delimiter, lineterminator="\n")
        if header:
            writer.writerow(header)
        for row in after:
            writer.writerow(row)
        writer.writerows([text(value) for value in row] for row in zip(*columns, strict=True))


def lines_of(signals):
    """The signals of a MAP, from (signal, column, unit[, sign[, offset]])."""
    for name, column, unit, *rest in signals:
        key = "expression" if column.startswith("=") else "column"
        extra = "".join(f", {what}: {value}" for what, value in zip(("sign", "offset"), rest, strict=False))
        yield f"      {name}: {{{key}: '{column.lstrip('=')}', unit: '{unit}'{extra}}}"


def map_of(*tables, clock=None):
    """A MAP from (file, time, signals)."""
    parts = [f"clock: {clock}"] if clock else []
    parts.append("tables:")
    for file, time, signals in tables:
        parts += (
            [f"  - time: {time}"] + ([f"    file: '{file}'"] if file else []) + ["    signals:", *lines_of(signals)]
        )
    return "\n".join(parts) + "\n"


def flight_test_csv(flown, folder):
    """One CSV of a flight test: ft, kt, deg, g with Nz up, seconds from the first row, blanks between slow samples."""
    stamp, c = flown.on_one_grid(held=False)
    degrees = np.degrees
    columns = {
        "Time (s)": (stamp - stamp[0]) * 1e-9,
        "Nx (g)": c["fx"] / GRAVITY,
        "Ny (g)": c["fy"] / GRAVITY,
        "Nz (g)": -c["fz"] / GRAVITY,
        "P (deg/s)": degrees(c["wx"]),
        "Q (deg/s)": degrees(c["wy"]),
        "R (deg/s)": degrees(c["wz"]),
        "Lat (deg)": c["lat"],
        "Lon (deg)": c["lon"],
        "Alt (ft)": c["alt"] / FOOT,
        "Vn (ft/s)": c["vn"] / FOOT,
        "Ve (ft/s)": c["ve"] / FOOT,
        "Climb (ft/min)": -c["vd"] / FOOT * 60.0,
        "KTAS": c["true_airspeed"] / KNOT,
        "AOA (deg)": degrees(c["angle_of_attack"]),
        "AOS (deg)": degrees(c["sideslip"]),
        "Ps (inHg)": c["static_pressure"] / 3386.388640341,
        "Rho (slug/ft3)": c["air_density"] / 515.3788183931961,
        "Elev TEU (deg)": -degrees(c["elevator"]),
        "Ail (deg)": degrees(c["aileron"]),
        "Rud (deg)": degrees(c["rudder"]),
        "Flap (deg)": degrees(c["flaps"]),
        "PLA (%)": c["throttle"] * 100.0,
        "Thrust (lbf)": c["thrust"] / 4.4482216152605,
        "RPM": c["propeller_speed"] * 30.0 / np.pi,
    }
    write_rows(
        folder / "FT0231.csv", list(columns), list(columns.values()), above=["Flight 231, 2024-05-31, N12345", ""]
    )
    start = datetime.fromtimestamp(stamp[0] * 1e-9, timezone.utc).isoformat()
    signals = [
        ("specific_force.x", "Nx (g)", "g"),
        ("specific_force.y", "Ny (g)", "g"),
        ("specific_force.z", "Nz (g)", "g", -1),
        ("angular_velocity.x", "P (deg/s)", "deg/s"),
        ("angular_velocity.y", "Q (deg/s)", "deg/s"),
        ("angular_velocity.z", "R (deg/s)", "deg/s"),
        ("latitude", "Lat (deg)", "deg"),
        ("longitude", "Lon (deg)", "deg"),
        ("altitude", "Alt (ft)", "ft"),
        ("velocity.north", "Vn (ft/s)", "ft/s"),
        ("velocity.east", "Ve (ft/s)", "ft/s"),
        ("velocity.down", "Climb (ft/min)", "ft/min", -1),
        ("true_airspeed", "KTAS", "kt"),
        ("angle_of_attack", "AOA (deg)", "deg"),
        ("sideslip", "AOS (deg)", "deg"),
        ("static_pressure", "Ps (inHg)", "inHg"),
        ("air_density", "Rho (slug/ft3)", "slug/ft3"),
        ("elevator", "Elev TEU (deg)", "deg", -1),
        ("aileron", "Ail (deg)", "deg"),
        ("rudder", "Rud (deg)", "deg"),
        ("flaps", "Flap (deg)", "deg"),
        ("throttle", "PLA (%)", "%"),
        ("thrust", "Thrust (lbf)", "lbf"),
        ("propeller_speed", "RPM", "rpm"),
    ]
    return folder / "FT0231.csv", map_of((None, "{column: 'Time (s)', unit: s}", signals), clock=f"'{start}'")


def ulog2csv_folder(flown, folder):
    """A folder of ulog2csv: a file a topic, microseconds since power-up, arrays as xyz[0] …, 1e-7 degrees."""
    zero = flown.stamp["imu/data"][0] - 539_000_000_000

    def topic(name, key, columns):
        time = (flown.stamp[key] - zero) // 1000
        write_rows(
            folder / f"log_{name}_0.csv",
            ["timestamp", "timestamp_sample", *columns],
            [time + 120, time, *columns.values()],
        )

    topic("vehicle_acceleration", "imu/data", {f"xyz[{i}]": flown.force[:, i] for i in range(3)})
    topic("vehicle_angular_velocity", "imu/data", {f"xyz[{i}]": flown.rate[:, i] for i in range(3)})
    gps = {
        "lat": np.round(flown.place[:, 0] * 1e7).astype(int),
        "lon": np.round(flown.place[:, 1] * 1e7).astype(int),
        "alt": np.round(flown.place[:, 2] * 1e3).astype(int),
        "vel_n_m_s": flown.velocity[:, 0],
        "vel_e_m_s": flown.velocity[:, 1],
        "vel_d_m_s": flown.velocity[:, 2],
    }
    topic("vehicle_gps_position", "gps/fix", gps)
    topic("airspeed_validated", "air_data", {"true_airspeed_m_s": flown.air["true_airspeed"]})
    time = "{column: timestamp_sample, unit: us}"
    return folder, map_of(
        (
            "*_vehicle_acceleration_0.csv",
            time,
            [(f"specific_force.{a}", f"xyz[{i}]", "m/s^2") for i, a in enumerate(AXES)],
        ),
        (
            "*_vehicle_angular_velocity_0.csv",
            time,
            [(f"angular_velocity.{a}", f"xyz[{i}]", "rad/s") for i, a in enumerate(AXES)],
        ),
        (
            "*_vehicle_gps_position_0.csv",
            time,
            [
                ("latitude", "lat", "1e-7 deg"),
                ("longitude", "lon", "1e-7 deg"),
                ("altitude", "alt", "mm"),
                ("velocity.north", "vel_n_m_s", "m/s"),
                ("velocity.east", "vel_e_m_s", "m/s"),
                ("velocity.down", "vel_d_m_s", "m/s"),
            ],
        ),
        ("*_airspeed_validated_0.csv", time, [("true_airspeed", "true_airspeed_m_s", "m/s")]),
        clock=f"'{datetime.fromtimestamp(zero // 1000 * 1e-6, timezone.utc).isoformat()}'",
    )


def rostopic_folder(flown, folder):
    """A folder of `rostopic echo -p`: nanoseconds of Unix time, FLU and ENU, degrees."""

    def topic(name, key, columns):
        stamp = flown.stamp[key]
        header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", *columns]
        write_rows(
            folder / f"flight-mavros-{name}.csv",
            header,
            [stamp + 400_000, np.arange(len(stamp)), stamp, ["base_link"] * len(stamp), *columns.values()],
        )

    imu = {f"field.angular_velocity.{a}": flown.rate[:, i] * FLU[i] for i, a in enumerate(AXES)}
    imu |= {f"field.linear_acceleration.{a}": flown.force[:, i] * FLU[i] for i, a in enumerate(AXES)}
    topic("imu-data_raw", "imu/data", imu)
    topic(
        "global_position-raw-fix",
        "gps/fix",
        {f"field.{n}": flown.place[:, i] for i, n in enumerate(("latitude", "longitude", "altitude"))},
    )
    north, east, down = flown.velocity.T
    topic(
        "global_position-raw-gps_vel",
        "gps/vel",
        {"field.twist.linear.x": east, "field.twist.linear.y": north, "field.twist.linear.z": -down},
    )
    topic(
        "nav_info-airspeed",
        "air_data",
        {"field.commanded": np.full(len(flown.stamp["air_data"]), 15.0), "field.measured": flown.air["true_airspeed"]},
    )
    time = "{column: field.header.stamp, unit: ns}"
    sign = {"x": 1, "y": -1, "z": -1}
    return folder, map_of(
        (
            "*-mavros-imu-data_raw.csv",
            time,
            [
                *((f"angular_velocity.{a}", f"field.angular_velocity.{a}", "rad/s", sign[a]) for a in AXES),
                *((f"specific_force.{a}", f"field.linear_acceleration.{a}", "m/s^2", sign[a]) for a in AXES),
            ],
        ),
        (
            "*-raw-fix.csv",
            time,
            [
                ("latitude", "field.latitude", "deg"),
                ("longitude", "field.longitude", "deg"),
                ("altitude", "field.altitude", "m"),
            ],
        ),
        (
            "*-gps_vel.csv",
            time,
            [
                ("velocity.north", "field.twist.linear.y", "m/s"),
                ("velocity.east", "field.twist.linear.x", "m/s"),
                ("velocity.down", "field.twist.linear.z", "m/s", -1),
            ],
        ),
        ("*-airspeed.csv", time, [("true_airspeed", "field.measured", "m/s")]),
        clock="utc",
    )


def mat_7_3(flown, folder):
    """A MAT 7.3 file: a structure for each instrument, row vectors and matrices stored the way of MATLAB."""
    path = folder / "sortie.mat"
    start = flown.stamp["imu/data"][0]
    with h5py.File(path, "w", userblock_size=512) as file:

        def put(group, name, values):
            data = file.require_group(group).create_dataset(name, data=np.atleast_2d(values))
            data.attrs["MATLAB_class"] = np.bytes_("double")

        def clock(group, key):
            file.require_group(group).attrs["MATLAB_class"] = np.bytes_("struct")
            put(group, "t", (flown.stamp[key] - start) * 1e-9)

        clock("IMU", "imu/data")
        put("IMU", "acc", flown.force.T)  # as MATLAB stores (n, 3)
        put("IMU", "gyro", np.degrees(flown.rate.T))
        clock("GPS", "gps/fix")
        put("GPS", "llh", flown.place.T)
        put("GPS", "vned", flown.velocity.T)
        clock("ADC", "air_data")
        put("ADC", "tas", flown.air["true_airspeed"] * 3.6)
        put("ADC", "alpha", flown.air["angle_of_attack"])
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    time = "{column: t, unit: s, offset: 0.25}"
    return path, map_of(
        (
            "IMU",
            time,
            [
                *((f"specific_force.{a}", f"acc[{i}]", "m/s^2") for i, a in enumerate(AXES)),
                *((f"angular_velocity.{a}", f"gyro[{i}]", "deg/s") for i, a in enumerate(AXES)),
            ],
        ),
        (
            "GPS",
            time,
            [
                ("latitude", "llh[0]", "deg"),
                ("longitude", "llh[1]", "deg"),
                ("altitude", "llh[2]", "m"),
                *((f"velocity.{d}", f"vned[{i}]", "m/s") for i, d in enumerate(("north", "east", "down"))),
            ],
        ),
        ("ADC", time, [("true_airspeed", "tas", "km/h"), ("angle_of_attack", "alpha", "rad")]),
        clock=f"'{(datetime.fromtimestamp(start // 1000 * 1e-6, timezone.utc) - timedelta(seconds=0.25)).isoformat()}'",
    )


def excel_book(flown, folder):
    """A workbook with a sheet of text, a sheet with names, units and held slow columns, and one with inputs."""
    path = folder / "Flight 7.xlsx"
    book = openpyxl.Workbook()
    book.active.title = "Notes"
    book.active.append(["Calibration of the boom: see mail"])
    stamp, c = flown.on_one_grid(held=True)
    sheet = book.create_sheet("Data")
    sheet.append(["Flight 7", None, "two pilots"])
    sheet.append([])
    names = ["Time", "AX", "AY", "AZ", "p", "q", "r", "V", "lat", "lon", "h", "vn", "ve", "vd"]
    sheet.append(names)
    sheet.append(
        ["sec", "ft/s^2", "ft/s^2", "ft/s^2", "deg/s", "deg/s", "deg/s", "kts", "deg", "deg", "ft", "m/s", "m/s", "m/s"]
    )
    columns = [
        (stamp - stamp[0]) * 1e-9,
        *(c[f"f{a}"] / FOOT for a in AXES),
        *(np.degrees(c[f"w{a}"]) for a in AXES),
        c["true_airspeed"] / KNOT,
        c["lat"],
        c["lon"],
        c["alt"] / FOOT,
        c["vn"],
        c["ve"],
        c["vd"],
    ]
    for row in zip(*columns, strict=True):
        sheet.append([None if np.isnan(value) else float(value) for value in row])
    inputs = book.create_sheet("Inputs")
    inputs.append(["UTC", "stab [deg]", "tab [deg]"])
    for at, de in zip(flown.stamp["control_surfaces"], flown.controls["elevator"], strict=True):
        moment = datetime(1970, 1, 1) + timedelta(microseconds=int(at) // 1000)
        inputs.append([moment.isoformat(), float(np.degrees(de)), float(2.0 * np.degrees(de))])
    book.save(path)
    data = [
        *((f"specific_force.{a}", f"A{a.upper()}", "ft/s^2") for a in AXES),
        *((f"angular_velocity.{a}", n, "deg/s") for a, n in zip(AXES, "pqr", strict=True)),
        ("true_airspeed", "V", "kts"),
        ("latitude", "lat", "deg"),
        ("longitude", "lon", "deg"),
        ("altitude", "h", "ft"),
        ("velocity.north", "vn", "m/s"),
        ("velocity.east", "ve", "m/s"),
        ("velocity.down", "vd", "m/s"),
    ]
    start = datetime.fromtimestamp(stamp[0] // 1000 * 1e-6, timezone.utc).isoformat()
    return path, map_of(
        ("Data", "{column: Time, unit: s}", data),
        (
            "Inputs",
            "{column: UTC, unit: iso}",
            [("elevator", "stab [deg]", "deg"), ("inputs.trim_tab", "tab [deg]", "deg")],
        ),
        clock=f"'{start}'",
    )


def ascii_columns(flown, folder):
    """Columns between blanks under a comment, a file with milliseconds and one with UTC."""
    start = int(flown.stamp["imu/data"][0])
    imu = folder / "imu.txt"
    with imu.open("w") as file:
        file.write("# inertial data of the logger\n# t_ms ax ay az p q r\n")
        for at, f, w in zip(flown.stamp["imu/data"], flown.force, flown.rate, strict=True):
            file.write("  ".join(f"{v:.12g}" for v in ((at - start) * 1e-6, *f, *np.degrees(w))) + "\n")
    gps = folder / "gps.txt"
    with gps.open("w") as file:
        file.write("UTC;Lat;Lon;Hoehe;v_n;v_e;v_d\n")
        for at, place, v in zip(flown.stamp["gps/fix"], flown.place, flown.velocity, strict=True):
            moment = datetime(1970, 1, 1) + timedelta(microseconds=int(at) // 1000)
            file.write(
                ";".join([moment.isoformat() + "Z", *(f"{x:.12g}".replace(".", ",") for x in (*place, *v))]) + "\n"
            )
    return folder, map_of(
        (
            "imu.txt",
            f"{{column: t_ms, unit: ms, offset: {start % 1_000_000_000 / 1e6}}}",
            [
                *((f"specific_force.{a}", f"a{a}", "m/s^2") for a in AXES),
                *((f"angular_velocity.{a}", n, "deg/s") for a, n in zip(AXES, "pqr", strict=True)),
            ],
        ),
        (
            "gps.txt",
            "{column: UTC, unit: iso}",
            [
                ("latitude", "Lat", "deg"),
                ("longitude", "Lon", "deg"),
                ("altitude", "Hoehe", "m"),
                ("velocity.north", "v_n", "m/s"),
                ("velocity.east", "v_e", "m/s"),
                ("velocity.down", "v_d", "m/s"),
            ],
        ),
        clock=f"'{datetime.fromtimestamp(start // 1_000_000_000, timezone.utc).isoformat()}'",
    )


def parquet_table(flown, folder):
    """A Parquet table with a time of nanoseconds, dynamic pressure instead of an airspeed, and nothing below 25 Hz."""
    keep = slice(None, None, 2)
    columns = {
        "when": pyarrow.array(flown.stamp["imu/data"][keep].astype("datetime64[ns]")),
        **{f"acc_{a}": flown.force[keep, i] for i, a in enumerate(AXES)},
        **{f"gyr_{a}": flown.rate[keep, i].astype(np.float64) for i, a in enumerate(AXES)},
    }
    pyarrow.parquet.write_table(pyarrow.table(columns), folder / "part.parquet", row_group_size=100)
    return folder / "part.parquet", map_of(
        (
            None,
            "{column: when, unit: iso}",
            [
                *((f"specific_force.{a}", f"acc_{a}", "m/s^2") for a in AXES),
                *((f"angular_velocity.{a}", f"gyr_{a}", "rad/s") for a in AXES),
            ],
        ),
    )
