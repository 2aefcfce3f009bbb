"""Effects in the measurement: nothing is wrong with the aeroplane, but with what its sensors are said to do.

Each changes numbers of the aircraft file; ``effect.with_setting`` says how a value of the inner number does.
"""

from __future__ import annotations

from collections.abc import Iterable

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.effects.effect import LONGITUDINAL, MEASUREMENT, Effect, ShapeParameter, Tie, Variant


def _of_drift(axes: Iterable[str], slope: str, factor: float) -> Variant:
    """Coefficients C(x) with x + d t in the place of x: C - d t dC/dx, with one d in all axes."""
    terms = {axis: (f"time*{{{axis}{slope}}}",) for axis in axes}
    return Variant("in forces and moments", terms, ties=dict.fromkeys(terms, (Tie(0, factor),)))


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "alpha_scale",
        "Scale of the angle of attack",
        MEASUREMENT,
        "A vane or probe sits in the upwash of wing and fuselage and shows more than the angle of the free stream. "
        "The factor is as constant as the place of the sensor.",
        "V. Klein and E. Morelli, Aircraft System Identification; W. Gracey, Measurement of Aircraft Speed and "
        "Altitude, NASA RP-1046",
        "α_measured = λ α",
        (Variant(setting=("sensors", "angle_of_attack", "scale")),),
        "Innovations of α in phase with pitch motion; C_Z,α and C_m,α wrong by the factor; wind that turns with pitch.",
        "Pushover and pull-up, speed changes in level flight (where α is the pitch angle).",
        (ShapeParameter("scale", "", 0.8, 1.25, 10),),
    ),
    Effect(
        "beta_scale",
        "Scale of sideslip",
        MEASUREMENT,
        "A vane or probe beside or before the fuselage sits in its sidewash and shows another angle than the free "
        "stream has. The factor is as constant as the place of the sensor.",
        "V. Klein and E. Morelli, Aircraft System Identification",
        "β_measured = λ β",
        (Variant(setting=("sensors", "sideslip", "scale")),),
        "Innovations of β in phase with yaw motion; every β derivative wrong by the factor.",
        "Rudder doublets and steady sideslips to both sides.",
        (ShapeParameter("scale", "", 0.8, 1.25, 10),),
    ),
    Effect(
        "airspeed_scale",
        "Scale of airspeed",
        MEASUREMENT,
        "Static ports in disturbed pressure and a pitot tube out of line read too high or too low by a share. All "
        "coefficients are then wrong by its square.",
        "W. Gracey, Measurement of Aircraft Speed and Altitude, NASA RP-1046; V. Klein and E. Morelli, "
        "Aircraft System Identification",
        "V_measured = λ V",
        (Variant(setting=("sensors", "airspeed", "scale")),),
        "The wind that is found turns with the heading; C_Z,α and all others wrong by λ².",
        "Turns through all headings in steady wind, speed changes.",
        (ShapeParameter("scale", "", 0.85, 1.15, 9),),
    ),
    Effect(
        "alpha_offset",
        "Offset of the angle of attack",
        MEASUREMENT,
        "A vane or probe that is mounted or calibrated a few degrees wrong shows all angles of attack too large or too "
        "small by the same angle. A vertical wind is then found that changes with speed and bank.",
        "V. Klein and E. Morelli, Aircraft System Identification; (6.16)-(6.18) of docs/references.md",
        "α_measured = α + b",
        (Variant(setting=("sensors", "angle_of_attack", "offset")),),
        "A vertical wind in proportion to the airspeed, which turns to the side in banked flight.",
        "Steep turns and speed changes in calm air.",
        (ShapeParameter("offset", "rad", -0.1, 0.1, 9),),
    ),
    Effect(
        "beta_offset",
        "Offset of sideslip",
        MEASUREMENT,
        "A vane for sideslip that is mounted a few degrees wrong shows all angles too large or too small by the same "
        "angle. A wind from the side is then found that turns with the heading.",
        "V. Klein and E. Morelli, Aircraft System Identification; (6.16)-(6.18) of docs/references.md",
        "β_measured = β + b",
        (Variant(setting=("sensors", "sideslip", "offset")),),
        "A wind from the side in proportion to the airspeed, which turns with the heading.",
        "Turns through all headings in calm air.",
        (ShapeParameter("offset", "rad", -0.1, 0.1, 9),),
    ),
    Effect(
        "airspeed_drift",
        "Airspeed that drifts",
        MEASUREMENT,
        "Ice or dirt that closes a pitot tube slowly makes it show less and less of the airspeed. All coefficients "
        "seem to grow by twice that share, as if the aeroplane grew heavier.",
        "W. Gracey, Measurement of Aircraft Speed and Altitude, NASA RP-1046",
        "V_measured = V (1 + d t)",
        (Variant(setting=("sensors", "airspeed", "drift")),),
        "The wind that is found turns with the heading, more from minute to minute.",
        "Turns through all headings in steady wind, at the beginning and at the end.",
        (ShapeParameter("drift", "1/s", -0.001, 0.001, 9),),
        in_coefficients=_of_drift(AXES, "_airspeed", 1.0),
    ),
    Effect(
        "alpha_drift",
        "Angle of attack that drifts",
        MEASUREMENT,
        "A vane that is bending, or turns on its shaft, shows an angle with an error that grows. The lift at the angle "
        "that it shows then changes with time, and a vertical wind seems to rise.",
        "W. Gracey, Measurement of Aircraft Speed and Altitude, NASA RP-1046; V. Klein and E. Morelli, "
        "Aircraft System Identification",
        "α_measured = α + d t",
        (Variant(setting=("sensors", "angle_of_attack", "drift")),),
        "A vertical wind that grows and turns with the bank of the aeroplane; constants of C_Z and C_m that change.",
        "Straight flight and steep turns in calm air, at the beginning and at the end.",
        (ShapeParameter("drift", "rad/s", -0.001, 0.001, 9),),
        in_coefficients=_of_drift(LONGITUDINAL, "_alpha", -1.0),
    ),
    Effect(
        "beta_drift",
        "Sideslip that drifts",
        MEASUREMENT,
        "A vane for sideslip that is bending, or turns on its shaft, shows an angle with an error that grows. A wind "
        "from the side then seems to rise and to turn with the heading.",
        "W. Gracey, Measurement of Aircraft Speed and Altitude, NASA RP-1046; V. Klein and E. Morelli, "
        "Aircraft System Identification",
        "β_measured = β + d t",
        (Variant(setting=("sensors", "sideslip", "drift")),),
        "A wind that turns with the heading and grows; constants of C_Y, C_l and C_n that change.",
        "Turns through all headings in calm air, at the beginning and at the end.",
        (ShapeParameter("drift", "rad/s", -0.001, 0.001, 9),),
        in_coefficients=_of_drift(("CY", "Cl", "Cn"), "_beta", -1.0),
    ),
    Effect(
        "air_data_lag",
        "Lag of the air data",
        MEASUREMENT,
        "Long pressure tubes, filters in the sensor and vanes with inertia show air data later than they are. In quick "
        "manoeuvres the late angle looks like damping.",
        "W. Gracey, Measurement of Aircraft Speed and Altitude, NASA RP-1046; V. Klein and E. Morelli, "
        "Aircraft System Identification",
        "V, α, β measured at t show t - τ",
        (
            Variant("all air data", setting=("sensors", "air_data", "delay")),
            Variant("angle of attack", setting=("sensors", "angle_of_attack", "delay")),
            Variant("sideslip", setting=("sensors", "sideslip", "delay")),
            Variant("airspeed", setting=("sensors", "airspeed", "delay")),
        ),
        "Innovations of α and β in phase with their rates.",
        "Quick elevator and rudder doublets.",
        (ShapeParameter("delay", "s", 0.0, 0.3, 11),),
    ),
    Effect(
        "probe_offset",
        "Place of the air data probe",
        MEASUREMENT,
        "A probe away from the centre of gravity moves with the rotation of the aeroplane and meets other air "
        "velocities: ω × r. With a wrong place in the file this is taken off in the wrong amount.",
        "V. Klein and E. Morelli, Aircraft System Identification; (6.3) of docs/references.md",
        "velocity at the probe = u + ω × (r + d)",
        (
            Variant("ahead", setting=("air_data_position", "x")),
            Variant("sideways", setting=("air_data_position", "y")),
            Variant("below", setting=("air_data_position", "z")),
        ),
        "Innovations of α in phase with p or q, of β with r or p, of V with r or q.",
        "Rolls, quick pitch and yaw doublets.",
        (ShapeParameter("shift", "span", -0.5, 0.5, 9),),
    ),
    Effect(
        "imu_offset",
        "Place of the IMU",
        MEASUREMENT,
        "An accelerometer away from the centre of gravity measures the acceleration of rotation as well: "
        "ω' × r + ω × (ω × r). With a wrong place in the file forces have a part of the moments in them.",
        "V. Klein and E. Morelli, Aircraft System Identification; (6.3) of docs/references.md",
        "A_IMU = A + ω' × (r + d) + ω × (ω × (r + d))",
        (
            Variant("ahead", setting=("imu_position", "x")),
            Variant("sideways", setting=("imu_position", "y")),
            Variant("below", setting=("imu_position", "z")),
        ),
        "Errors of C_Z in phase with the pitch acceleration, of C_Y with those of roll and yaw.",
        "Quick doublets of all surfaces.",
        (ShapeParameter("shift", "span", -0.3, 0.3, 9),),
    ),
    Effect(
        "imu_lag",
        "IMU later than recorded",
        MEASUREMENT,
        "Filters in an IMU, or in what records it, smooth rates and accelerations and make them late, while attitude "
        "and velocity of an onboard filter are on time. Controls and flow angles then seem to come early, as if the "
        "flow or the surfaces had a memory.",
        "R. Jategaonkar, Flight Vehicle System Identification (data compatibility, time shifts)",
        "ω and A measured at t show t - τ",
        (Variant(setting=("sensors", "imu", "delay")),),
        "Innovations of attitude and GPS velocity in phase with rates and accelerations.",
        "Quick doublets of all surfaces, steep turns.",
        (ShapeParameter("delay", "s", 0.0, 0.2, 11),),
    ),
    Effect(
        "gps_lag",
        "GPS later than recorded",
        MEASUREMENT,
        "A receiver needs a tenth of a second or more for a solution, and the stamp is often that of its arrival. The "
        "velocity over ground then lags behind the motion, as if there were a wind that turns with each manoeuvre.",
        "R. Jategaonkar, Flight Vehicle System Identification (data compatibility, time shifts)",
        "position and velocity measured at t show t - τ",
        (Variant(setting=("sensors", "gps", "delay")),),
        "Innovations of GPS velocity in phase with the acceleration.",
        "Steep turns, pull-ups, speed changes.",
        (ShapeParameter("delay", "s", 0.0, 0.5, 11),),
    ),
    Effect(
        "actuator_lag",
        "Surfaces later than recorded",
        MEASUREMENT,
        "What is recorded is often the command and not the surface, which follows through servo and linkage some "
        "hundredths of a second later: as a whole, or the more slowly the nearer it comes. Control moments then come "
        "late, and rates seem to act early.",
        "R. Jategaonkar, Flight Vehicle System Identification; V. Klein and E. Morelli, Aircraft System Identification",
        "δ(t) = δ_recorded(t - τ), or τ δ' + δ = δ_recorded",
        (
            Variant(setting=("sensors", "control_surfaces", "delay")),
            Variant(
                "lag of the servos",
                setting=("sensors", "control_surfaces", "lag"),
                inner=(ShapeParameter("lag", "s", 0.0, 0.25, 11),),
            ),
        ),
        "Errors of C_m, C_l and C_n that are the rate of change of the surface.",
        "Doublets and 3-2-1-1 with sharp edges.",
        (ShapeParameter("delay", "s", -0.25, 0.0, 11),),
    ),
    Effect(
        "late_controls",
        "Surfaces recorded late",
        MEASUREMENT,
        "A recorder that buffers, filters or polls the deflections stamps them some hundredths of a second after the "
        "surface was there. Rates then seem to act before the surface that makes them.",
        "R. Jategaonkar, Flight Vehicle System Identification; V. Klein and E. Morelli, Aircraft System Identification",
        "δ(t) = δ_recorded(t + τ)",
        (Variant(setting=("sensors", "control_surfaces", "delay")),),
        "Errors of C_m, C_l and C_n that are the rate of change of the surface.",
        "Doublets and 3-2-1-1 with sharp edges.",
        (ShapeParameter("delay", "s", 0.0, 0.25, 11),),
    ),
    Effect(
        "wind_change",
        "Wind that changes faster than assumed",
        MEASUREMENT,
        "The reconstruction takes the wind for nearly constant; a front, wave or shear changes it within seconds. "
        "Until the estimate has followed, the flow angles are wrong.",
        "MIL-F-8785C, 3.7.3 (discrete gusts); (6.16)-(6.18) of docs/references.md hold for constant wind only",
        "random walk of the wind larger than the process noise of the file",
        (Variant(setting=("process_noise", "wind")),),
        "A stretch of some seconds with innovations of V, α, β and of the GPS velocity, errors in all axes.",
        "Straight flight through the change.",
        (ShapeParameter("walk", "m/s/√s", 0.02, 2.0, 7),),
    ),
)
