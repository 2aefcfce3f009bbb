"""One simulated flight as columns of numbers, for the layouts of tables and bags."""

import numpy as np

from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples


def flown_columns():
    """90 s with turns at 100 Hz in SI, FRD and NED, by signal, and ``time`` [s]."""
    truth = simulate_samples(default_aircraft(), seed=5, duration=90.0, wind=(3.0, -2.0, 0.0), rate=200.0).truth[::2]
    rng = np.random.default_rng(1)
    euler = np.unwrap([euler_from_quaternion(q) for q in truth.quaternion], axis=0)
    latitude, longitude, altitude = truth.origin
    columns = {
        **{
            f"specific_force.{a}": truth.specific_force[:, i] + rng.normal(0, 0.05, len(truth.time))
            for i, a in enumerate("xyz")
        },
        **{
            f"angular_velocity.{a}": truth.rates[:, i] + rng.normal(0, 0.003, len(truth.time))
            for i, a in enumerate("xyz")
        },
        **{f"attitude.{name}": euler[:, i] for i, name in enumerate(("roll", "pitch", "yaw"))},
        **{f"velocity.{way}": truth.velocity[:, i] for i, way in enumerate(("north", "east", "down"))},
        "latitude": latitude + truth.position[:, 0] / 6.371e6,
        "longitude": longitude + truth.position[:, 1] / (6.371e6 * np.cos(latitude)),
        "altitude": altitude - truth.position[:, 2],
        "true_airspeed": truth.airspeed,
        "indicated_airspeed": truth.airspeed * np.sqrt(truth.density / 1.225),
        "angle_of_attack": truth.alpha,
        "sideslip": truth.beta,
        "elevator": truth.controls[:, 0],
        "aileron": truth.controls[:, 1],
        "rudder": truth.controls[:, 2],
        "throttle": truth.controls[:, 4],
        "dynamic_pressure": 0.5 * truth.density * truth.airspeed**2,
    }
    return {"time": truth.time, **columns}
