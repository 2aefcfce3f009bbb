"""Flights as flight-test systems write them down, each in a manner of its own; every function returns the source.

Made from the samples of a simulated flight with attitude, interpolated to the rate of the layout; what is noise of the
sensors stays, and what is between two of their samples is a straight line, as in any such system.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import numpy as np
import openpyxl
from scipy.io import savemat
from strange_layouts import FOOT, GRAVITY, KNOT, write_rows

from aircraft_sysid_ros.aircraft.atmosphere import altitude_at, temperature_at
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.samples import Kind

#: Signals by kind of sample.
NAMES = {
    Kind.IMU: ("fx", "fy", "fz", "p", "q", "r"),
    Kind.ATTITUDE: ("phi", "theta", "psi"),
    Kind.GPS_POSITION: ("lat", "lon", "alt"),
    Kind.GPS_VELOCITY: ("vn", "ve", "vd"),
    Kind.AIRSPEED: ("V",),
    Kind.ANGLE_OF_ATTACK: ("alpha",),
    Kind.SIDESLIP: ("beta",),
    Kind.AIR: ("rho", "ps"),
    Kind.CONTROLS: ("de", "da", "dr", "df", "throttle", "thrust", "omega"),
}


class Flown:
    """The samples of a flight: time [s] from the first one and values by kind, and all of them at any times."""

    def __init__(self, flight):
        samples, self.start = flight.samples, int(flight.samples.stamp.min())
        self.time, self.values = {}, {}
        for kind, names in NAMES.items():
            rows = samples.kind == kind
            order = np.argsort(samples.stamp[rows], kind="stable")
            values = samples.values[rows][order]
            if kind == Kind.ATTITUDE:
                values = np.unwrap([euler_from_quaternion(q[:4]) for q in values], axis=0)
            self.time[kind] = (samples.stamp[rows][order] - self.start) * 1e-9
            self.values[kind] = dict(zip(names, values.T, strict=False))

    def at(self, time):
        """Every signal at times (n,) [s]."""
        return {
            name: np.interp(time, self.time[kind], values)
            for kind, columns in self.values.items()
            for name, values in columns.items()
        }

    @property
    def end(self):
        """Last time [s] that all sensors have."""
        return min(time[-1] for time in self.time.values())


def business_jet(flown, folder, *, gravity=True):
    """A .mat of a jet's test system at 10 Hz: a structure for each signal, with data, units and a description.

    One vane, no sideslip, no GPS velocity; accelerations in g, the normal one upwards, ``gravity`` in them or not.
    """
    time = np.arange(0.2, flown.end, 0.1)
    c, held = flown.at(time), flown.at(np.floor(time))  # GPS once a second
    height = altitude_at(c["ps"])
    mach = c["V"] / np.sqrt(1.4 * 287.05287 * np.array([temperature_at(p) for p in c["ps"]]))
    axes = [
        c["fx"] / GRAVITY - (0.0 if gravity else np.sin(c["theta"])),
        c["fy"] / GRAVITY + (0.0 if gravity else np.cos(c["theta"]) * np.sin(c["phi"])),
        -c["fz"] / GRAVITY - (0.0 if gravity else np.cos(c["theta"]) * np.cos(c["phi"])),
    ]
    flow = 450.0 + 900.0 * c["throttle"]
    angles = {"delta_e": "de", "delta_a": "da", "delta_r": "dr"}
    columns = {
        "time": (time + 9.0, "sec", "Time since start of the recording"),
        "vane_AOA": (np.degrees(c["alpha"]), "deg", "Angle of attack"),
        "elevator_dte": (2.0 + 0.5 * np.sin(0.11 * time), "deg", "Deflection of elevator trim"),
        **{name: (np.degrees(c[key]), "deg", f"Deflection of {name}") for name, key in angles.items()},
        "lh_engine_FMF": (flow, "lbs/hr", "Engine 1: Fuel mass flow"),
        "rh_engine_FMF": (1.02 * flow, "lbs/hr", "Engine 2: Fuel mass flow"),
        "Dadc1_alt": (height / FOOT, "ft", "Pressure Altitude (1013.25 mB)"),
        "Dadc1_mach": (mach, "Unitless", "Mach"),
        "Dadc1_tas": (c["V"] / KNOT, "kts", "True Airspeed"),
        "Ahrs1_Roll": (np.degrees(c["phi"]), "deg", "Roll Angle"),
        "Ahrs1_Pitch": (np.degrees(c["theta"]), "deg", "Pitch Angle"),
        "Fms1_trueHeading": (np.degrees(c["psi"]) % 360.0, "deg", "True Heading"),
        **{
            f"Ahrs1_b{name}Rate": (np.degrees(c[key]), "deg/s", f"Body {name} Rate")
            for name, key in (("Roll", "p"), ("Pitch", "q"), ("Yaw", "r"))
        },
        **{
            f"Ahrs1_b{name}Acc": (axis, "g", f"Body {name} Acceleration")
            for name, axis in zip(("Long", "Lat", "Norm"), axes, strict=True)
        },
        "Gps_lat": (held["lat"] * 180.0 / np.pi, "deg", "GNSS Latitude"),
        "Gps_long": (held["lon"] * 180.0 / np.pi, "deg", "GNSS Longitude"),
        "measurement_running": (np.ones(len(time)), "no unit", "Measurement running"),
    }
    flightdata = {
        name: {"data": values[:, None], "units": unit, "description": text}
        for name, (values, unit, text) in columns.items()
    }
    path = folder / "FTISxprt.mat"
    savemat(path, {"flightdata": flightdata}, oned_as="column")
    return path


def ascii_manoeuvres(flown, folder, starts, length=10.0, rate=25.0):
    """Columns of numbers without a header, one manoeuvre after another, each from time 0, and a list of names."""
    blocks = []
    for start in starts:
        time = np.arange(0.0, length, 1.0 / rate)
        c = flown.at(start + time)
        degrees = [np.degrees(c[name]) for name in ("p", "q", "r", "phi", "theta", "psi", "alpha", "beta")]
        surfaces = [np.degrees(c[name]) for name in ("de", "da", "dr")]
        blocks.append([time, c["fx"], c["fy"], c["fz"], *degrees, c["V"], *surfaces, c["thrust"], altitude_at(c["ps"])])
    path = folder / "fAttas01.asc"
    np.savetxt(path, np.hstack(blocks).T, fmt="%14.6e")
    names = (
        ["t  s", "ax m/s2", "ay m/s2", "az m/s2", "p deg/s", "q deg/s", "r deg/s", "phi deg", "theta deg", "psi deg"]
        + ["alpha deg", "beta deg", "V m/s", "de deg", "da deg", "dr deg", "Thrust N", "h_press m"]
    )  # fmt: skip
    (folder / "fAttas01_names.txt").write_text("\n".join(names) + "\n")
    return path


def semicolons(flown, folder, rate=20.0):
    """A CSV with semicolons, decimal commas, date-times with a zone, and units in a second row of the header."""
    time = np.arange(0.1, flown.end, 1.0 / rate)
    c, zone = flown.at(time), timezone(timedelta(hours=2))
    begin = datetime(2024, 5, 31, 14, 5, tzinfo=zone)
    columns = {
        ("Zeit", ""): [(begin + timedelta(seconds=float(t))).isoformat(timespec="milliseconds") for t in time],
        ("nx", "g"): c["fx"] / GRAVITY,
        ("ny", "g"): c["fy"] / GRAVITY,
        ("nz", "g"): -c["fz"] / GRAVITY,
        ("p", "°/s"): np.degrees(c["p"]),
        ("q", "°/s"): np.degrees(c["q"]),
        ("r", "°/s"): np.degrees(c["r"]),
        ("Phi", "°"): np.degrees(c["phi"]),
        ("Theta", "°"): np.degrees(c["theta"]),
        ("Psi", "°"): np.degrees(c["psi"]) % 360.0,
        ("TAS", "km/h"): c["V"] * 3.6,
        ("Alpha", "°"): np.degrees(c["alpha"]),
        ("Beta", "°"): np.degrees(c["beta"]),
        ("Lat", "°"): np.degrees(c["lat"]),
        ("Lon", "°"): np.degrees(c["lon"]),
        ("H_GPS", "m"): c["alt"],
        ("Vg_N", "m/s"): c["vn"],
        ("Vg_E", "m/s"): c["ve"],
        ("Vario", "m/s"): -c["vd"],
        ("p_stat", "hPa"): c["ps"] / 100.0,
        ("Höhenruder", "°"): np.degrees(c["de"]),
        ("Querruder", "°"): np.degrees(c["da"]),
        ("Seitenruder", "°"): np.degrees(c["dr"]),
        ("Schub", "N"): c["thrust"],
    }
    path = folder / "Flug_12.csv"
    names, units = zip(*columns, strict=True)
    write_rows(path, names, list(columns.values()), delimiter=";", after=[units], decimal=",")
    return path


def sheets(flown, folder, seconds=np.inf):
    """A workbook with a sheet for each group of sensors: its own rate, its own clock, its own zero."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    degrees = np.degrees

    def sheet(title, kind, every, clock, columns):
        time = flown.time[kind][::every]
        rows = book.create_sheet(title)
        rows.append([clock[0], *columns])
        time = time[time < seconds]
        for values in zip(clock[1](time), *(c[::every][: len(time)] for c in columns.values()), strict=True):
            rows.append([value if isinstance(value, datetime) else float(value) for value in values])

    imu, air = flown.values[Kind.IMU], flown.values[Kind.AIRSPEED]
    forces = {f"acc {a} [m/s2]": imu[f"f{a}"] for a in "xyz"}
    rates = {f"gyro {a} [deg/s]": degrees(imu[n]) for a, n in zip("xyz", "pqr", strict=True)}
    sheet("IMU", Kind.IMU, 2, ("uptime [ms]", lambda t: 1000.0 * t + 5000.0), {**forces, **rates})
    attitude = {name: degrees(flown.values[Kind.ATTITUDE][name]) for name in ("phi", "theta", "psi")}
    labels = {"phi": "roll [deg]", "theta": "pitch [deg]", "psi": "heading [deg]"}
    columns = {labels[name]: values for name, values in attitude.items()}
    sheet("AHRS", Kind.ATTITUDE, 2, ("t [s]", lambda t: t), columns)
    gps = flown.values[Kind.GPS_POSITION] | flown.values[Kind.GPS_VELOCITY]
    columns = {"lat [deg]": degrees(gps["lat"]), "lon [deg]": degrees(gps["lon"]), "alt [m]": gps["alt"]}
    columns |= {f"v_{name} [m/s]": gps[f"v{name[0]}"] for name in ("north", "east", "down")}
    sheet("GPS", Kind.GPS_POSITION, 1, ("tow [s]", lambda t: t + 482_400.0 - 18.0), columns)
    columns = {"TAS [m/s]": air["V"], "alpha [deg]": degrees(flown.values[Kind.ANGLE_OF_ATTACK]["alpha"])}
    columns |= {"beta [deg]": degrees(flown.values[Kind.SIDESLIP]["beta"]), "p_s [Pa]": flown.values[Kind.AIR]["ps"]}
    noon = datetime(2024, 5, 31, 14, 0)

    def of_day(time):
        return [noon + timedelta(milliseconds=round(1000.0 * t)) for t in time]

    sheet("Air data", Kind.AIRSPEED, 2, ("UTC", of_day), columns)
    surfaces = flown.values[Kind.CONTROLS]
    columns = {f"{name} [deg]": degrees(surfaces[key]) for name, key in (("elev", "de"), ("ail", "da"), ("rud", "dr"))}
    columns |= {"thrust [N]": surfaces["thrust"]}
    sheet("Surfaces", Kind.CONTROLS, 1, ("time [s]", lambda t: t - 0.4), columns)
    path = folder / "Flight 12.xlsx"
    book.save(path)
    return path


def manoeuvre_columns(flown, time, start):
    """Columns with units of one manoeuvre that begins at ``start`` [s] of the flight, at times (n,) [s] of its own."""
    c = flown.at(start + time)
    columns = {"Time [s]": time, "Nx [g]": c["fx"] / GRAVITY, "Ny [g]": c["fy"] / GRAVITY, "Nz [g]": -c["fz"] / GRAVITY}
    columns |= {f"{n} [deg/s]": np.degrees(c[n]) for n in "pqr"}
    angles = {"Phi": "phi", "Theta": "theta", "Psi": "psi", "Alpha": "alpha", "Beta": "beta", "Elevator": "de"}
    angles |= {"Aileron": "da", "Rudder": "dr"}
    columns |= {f"{name} [deg]": np.degrees(c[key]) for name, key in angles.items()}
    return columns | {"TAS [m/s]": c["V"], "Hp [m]": altitude_at(c["ps"])}


def sheet_per_manoeuvre(flown, folder, starts, rate=25.0):
    """A workbook with a sheet for each manoeuvre, each from time 0."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for number, start in enumerate(starts, 1):
        columns = manoeuvre_columns(flown, np.arange(0.0, 8.0 + number, 1.0 / rate), start)
        sheet = book.create_sheet(f"Man {number}")
        sheet.append(list(columns))
        for row in np.stack(list(columns.values()), axis=1).tolist():
            sheet.append(row)
    path = folder / "Flight 13.xlsx"
    book.save(path)
    return path


def file_per_manoeuvre(flown, folder, starts, rate=25.0):
    """A folder with a CSV for each manoeuvre, whose clock goes on; by its name the tenth comes before the second."""
    for number, start in enumerate(starts, 1):
        columns = manoeuvre_columns(flown, np.arange(0.0, 8.0, 1.0 / rate), start)
        columns["Time [s]"] = columns["Time [s]"] + start
        content = np.stack(list(columns.values()), axis=1)
        np.savetxt(
            folder / f"run{number}.csv", content, fmt="%.9g", delimiter=",", header=",".join(columns), comments=""
        )
    return folder
