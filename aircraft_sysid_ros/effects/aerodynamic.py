"""Effects in the forces and moments that act all the time; (6.8)-(6.13) of docs/references.md have none of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection

from aircraft_sysid_ros.effects.effect import (
    AERODYNAMIC,
    BEGIN,
    LONGITUDINAL,
    OF_TIME,
    STEP,
    Domain,
    Effect,
    ShapeParameter,
    Tie,
    Variant,
    surface,
)

#: Share of the chord over which the flow is attached, in steady flight, and of the lift that separation takes away, by
#: Kirchhoff: from 0 to 3/4.
_ATTACHED = "0.5-0.5*tanh((alpha-{onset})/{width})"
_LIFT_LOST = f"(1-0.25*(1+sqrt({_ATTACHED}))**2)"
_LIFT_LOST_LATE = f"(1-0.25*(1+sqrt(lag({_ATTACHED},{{lag}})))**2)"


def _in_one_wash(name: str, axes: Collection[str]) -> Variant:
    """Tail surfaces that are in a slipstream as a whole: each part of their force grows by the same share of T_c.

    A force of the tail has one arm, whatever makes it: its moment is to it as those of the control surface.
    """
    terms: dict[str, tuple[str, ...]] = {}
    ties: dict[str, tuple[Tie, ...]] = {}
    number = itertools.count(1)
    for symbol, own, parts in (("de", ("Cm", "CZ"), ("alpha", "q")), ("dr", ("Cn", "CY"), ("beta", "r"))):
        shared = [axis for axis in own if axis in axes]
        numbers = (0, *(next(number) for _ in parts)) if shared else ()
        for axis in shared:
            terms[axis] = tuple(f"Tc*{signal}" for signal in (symbol, *parts))
            ties[axis] = tuple(Tie(k, of=f"{axis}_{symbol}") for k in numbers)
    return Variant(name, terms, ties=ties)


def _ice_on_one_wing(grown: str, name: str) -> Variant:
    """Its drag yaws, and the lift that it takes away rolls: each has an arm that nobody knows."""
    drag, lift = (grown,), (f"{grown}*alpha",)
    return Variant(f"{name} on one wing", {"CX": drag, "Cn": drag, "CZ": lift, "Cl": lift})


def _of_each_surface(term: Callable[[str], str]) -> tuple[Variant, ...]:
    """What becomes of the elevator, of the aileron or of the rudder, by a term of its deflection."""
    return (
        surface("elevator", ("Cm", "CZ"), (term("de"),)),
        surface("aileron", ("Cl", "Cn"), (term("da"),)),
        surface("rudder", ("Cn", "CY"), (term("dr"),)),
    )


def _slack(symbol: str) -> str:
    """What a surface lacks of its deflection in a dead zone: all of it inside, the half width of the zone outside."""
    return f"min(max({symbol}-{{centre}},-{{gap}}),{{gap}})"


def _late_by_rate(symbol: str) -> str:
    """What a surface lacks of its command while it moves as fast as it can."""
    return f"limited({symbol},{{rate}})-{symbol}"


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "stall",
        "Stall",
        AERODYNAMIC,
        "Beyond some angle of attack the flow leaves the upper side of the wing, so that lift grows less or falls "
        "and drag rises. The centre of pressure moves aft and the tail enters the wake, which changes the pitching "
        "moment.",
        "J. Roskam, Airplane Flight Dynamics and Automatic Flight Controls; R. Jategaonkar, Flight Vehicle System "
        "Identification (Goman and Khrabrov's point of separation)",
        "C_Z, C_X, C_m += a (α - α₀)⁺ + b ((α - α₀)⁺)², or (a + b α) (1 - (1 + √x)² / 4), "
        "x = (1 - tanh((α - α₀) / w)) / 2",
        (
            Variant(terms={axis: ("max(alpha-{onset},0)", "max(alpha-{onset},0)**2") for axis in LONGITUDINAL}),
            Variant("gradual", {axis: (_LIFT_LOST, f"{_LIFT_LOST}*alpha") for axis in LONGITUDINAL}),
        ),
        "No error below an angle of attack, above it C_Z, C_X and C_m run away together, on the way down longer than "
        "on the way up.",
        "Slow deceleration to the stall with elevator 3-2-1-1 near the onset; pull-ups.",
        (ShapeParameter("onset", "rad", 0.4, 0.92, 9, "alpha"), ShapeParameter("width", "rad", 0.015, 0.075, 3)),
        shows_in=("CZ",),
        signs={"CZ": 1.0},
        beyond_ordinary=True,
    ),
    Effect(
        "dynamic_stall",
        "Stall with a memory",
        AERODYNAMIC,
        "The flow does not leave the wing at once: the point of separation follows the angle of attack with a time of "
        "its own. Lift is therefore larger while the nose goes up than while it comes down, and drag and pitching "
        "moment have a loop as well.",
        "M. Goman and A. Khrabrov, State-Space Representation of Aerodynamic Characteristics of an Aircraft at High "
        "Angles of Attack, J. Aircraft 31(5), 1994; R. Jategaonkar, Flight Vehicle System Identification",
        "C_Z, C_X, C_m += (a + b α) (1 - (1 + √x)² / 4), τ x' + x = (1 - tanh((α - α*) / w)) / 2",
        (Variant(terms={axis: (_LIFT_LOST_LATE, f"{_LIFT_LOST_LATE}*alpha") for axis in LONGITUDINAL}),),
        "Errors of C_Z, C_X and C_m above an angle of attack that differ on the way up and on the way down.",
        "Stalls at several rates of pitch, each with a quick and with a slow recovery.",
        (
            ShapeParameter("onset", "rad", 0.45, 1.0, 6, "alpha"),
            ShapeParameter("width", "rad", 0.015, 0.075, 3),
            ShapeParameter("lag", "s", 0.1, 1.6, 4),
        ),
        shows_in=("CZ",),
        signs={"CZ": 1.0},
        beyond_ordinary=True,
    ),
    Effect(
        "ground_effect",
        "Ground effect",
        AERODYNAMIC,
        "Within about half a span of the ground the trailing vortices are mirrored, which turns the downwash up: the "
        "lift slope grows and induced drag falls. The tail meets less downwash, so that the nose is pushed down.",
        "B. McCormick, Aerodynamics, Aeronautics and Flight Mechanics; S. Hoerner, Fluid-Dynamic Lift",
        "C_Z, C_X, C_m += (a + b α) exp(-h / h₀)",
        (
            Variant(
                terms={
                    axis: ("exp(-max(height,0)/{decay})", "exp(-max(height,0)/{decay})*alpha")
                    for axis in LONGITUDINAL
                }
            ),
        ),
        "Errors of C_Z, C_X and C_m only in low passes, take-off and landing, the larger the lower.",
        "Low passes at different heights below a span, with small elevator pulses.",
        (ShapeParameter("decay", "m", 0.3, 8.0, 14),),
        domain=Domain("height", high=2.0, in_spans=True),
    ),
    Effect(
        "alpha_dot",
        "Lag of the downwash (α̇ derivatives)",
        AERODYNAMIC,
        "The downwash that the tail meets left the wing a moment ago, so that while the angle of attack changes the "
        "tail is at another angle than in steady flight. It damps the short period as C_m,q does, but differs from it "
        "when the path curves without α changing.",
        "B. Etkin and L. Reid, Dynamics of Flight; V. Klein and E. Morelli, Aircraft System Identification",
        "C_Z, C_m += a α̇ c/V",
        (Variant(terms={"CZ": ("alpha_dot",), "Cm": ("alpha_dot",)}),),
        "Errors of C_m, and less of C_Z, in quick elevator inputs, in phase with dα/dt; nearly what q explains.",
        "Pitch 3-2-1-1 together with steep turns, or plunging motion: q and α̇ must differ.",
        # - a_tail V_H dε/dα, with arm and volume of the tail: a volume of 1.5 and a downwash of 1, twice what is flown
        ranges={"CZ": (-7.0, 0.0), "Cm": (-30.0, 0.0)},
    ),
    Effect(
        "flaps",
        "Flaps",
        AERODYNAMIC,
        "Flaps camber the wing: more lift at the same angle of attack, more drag, and a pitching moment from the aft "
        "load and from the changed downwash at the tail. Drag grows faster than the deflection.",
        "J. Roskam, Airplane Design, part VI; B. McCormick, Aerodynamics, Aeronautics and Flight Mechanics",
        "C_Z, C_m += a δ_f, C_X += a δ_f + b δ_f²; on one side C_l, C_n += a δ_f as well",
        (
            Variant(terms={"CZ": ("flaps",), "CX": ("flaps", "flaps**2"), "Cm": ("flaps",)}),
            Variant(
                "with lift slope", {"CZ": ("flaps", "flaps*alpha"), "CX": ("flaps", "flaps*alpha"), "Cm": ("flaps",)}
            ),
            Variant("on one side", {axis: ("flaps",) for axis in ("CZ", "CX", "Cm", "Cl", "Cn")}),
        ),
        "Constant errors of C_Z, C_X and C_m while the flaps are out.",
        "Flaps out and in at constant speed, in two settings.",
    ),
    Effect(
        "propwash",
        "Slipstream over wing and tail",
        AERODYNAMIC,
        "The slipstream of the propeller has more dynamic pressure than the free stream, so that surfaces in it work "
        "better with thrust. Elevator, rudder and the inner wing gain in proportion to T_c S / A_propeller.",
        "W. Phillips, Mechanics of Flight; S. Hoerner, Fluid-Dynamic Lift",
        "C_m, C_Z += T_c (a δ_e + b α), C_n, C_Y += T_c (a δ_r + b β); of a tail that is in it as a whole C_m, C_Z += "
        "(C_m,δe, C_Z,δe) T_c (a δ_e + b α + c q), C_n, C_Y += (C_n,δr, C_Y,δr) T_c (a δ_r + d β + e r)",
        (
            Variant("elevator and wing", {"Cm": ("Tc*de", "Tc*alpha"), "CZ": ("Tc*de", "Tc*alpha")}),
            Variant("rudder", {"Cn": ("Tc*dr", "Tc*beta"), "CY": ("Tc*dr",)}),
            Variant(
                "elevator, wing and rudder",
                {
                    "Cm": ("Tc*de", "Tc*alpha"),
                    "CZ": ("Tc*de", "Tc*alpha"),
                    "Cn": ("Tc*dr", "Tc*beta"),
                    "CY": ("Tc*dr",),
                },
            ),
            _in_one_wash("fin", ("Cn", "CY")),
            _in_one_wash("tailplane and fin", ("Cm", "CZ", "Cn", "CY")),
        ),
        "The model is right at one power setting: at full power the answer to elevator and rudder is larger.",
        "Elevator and rudder doublets at idle and at full power, at the same speed.",
    ),
    Effect(
        "thrust_offset",
        "Thrust line above or below the centre of gravity",
        AERODYNAMIC,
        "A thrust line that passes the centre of gravity at a distance makes a pitching moment in proportion to "
        "thrust. A line that is not parallel to the body axis has a part of the thrust in C_Z as well.",
        "B. Stevens, F. Lewis and E. Johnson, Aircraft Control and Simulation; J. Roskam, Airplane Flight "
        "Dynamics and Automatic Flight Controls",
        "C_m += a T_c, C_Z += b T_c; by the throttle δ, with T = δ (T₀ - k V): C_m += a δ / q̄ + b δ / V",
        (
            Variant("offset", {"Cm": ("Tc",)}),
            Variant("offset and angle", {"Cm": ("Tc",), "CZ": ("Tc",)}),
            Variant("by the throttle", {"Cm": ("throttle/qbar",)}),
            Variant("by throttle and airspeed", {"Cm": ("throttle/qbar", "throttle/V")}),
        ),
        "Error of C_m that follows the throttle, at any attitude.",
        "Throttle steps at constant speed.",
    ),
    Effect(
        "propeller_torque",
        "Torque of the propeller",
        AERODYNAMIC,
        "What turns the propeller turns the aeroplane the other way. The reaction is a rolling moment that grows with "
        "power.",
        "W. Phillips, Mechanics of Flight; B. McCormick, Aerodynamics, Aeronautics and Flight Mechanics",
        "C_l += a T_c; by the throttle δ: C_l += a δ / q̄",
        (Variant(terms={"Cl": ("Tc",)}), Variant("by the throttle", {"Cl": ("throttle/qbar",)})),
        "Error of C_l that follows the throttle, without sideslip or aileron.",
        "Throttle steps with wings level.",
    ),
    Effect(
        "propeller_thrust",
        "Thrust that falls with airspeed",
        AERODYNAMIC,
        "At the same throttle δ a propeller pulls less the faster it flies, T = δ (T₀ - k V). Its part of C_X is not "
        "a constant times the throttle then, but falls with dynamic pressure and with speed.",
        "B. McCormick, Aerodynamics, Aeronautics and Flight Mechanics; J. Roskam and C. Lan, Airplane Aerodynamics and "
        "Performance",
        "C_X += a δ / q̄ + b δ / V",
        (
            Variant("static", {"CX": ("throttle/qbar",)}),
            Variant("falls with speed", {"CX": ("throttle/qbar", "throttle/V")}),
        ),
        "Error of C_X that follows the throttle, and turns its sign between low and high speed.",
        "Throttle steps at several speeds.",
    ),
    Effect(
        "propeller_gyroscopic",
        "Gyroscopic moments of the propeller",
        AERODYNAMIC,
        "A turning propeller is a gyroscope: to yaw it takes a pitching moment and to pitch it a yawing moment, "
        "M = -h r and N = h q with its angular momentum h. Pitch and yaw, which the aerodynamic model keeps apart, are "
        "coupled in proportion to the propeller speed.",
        "B. Etkin and L. Reid, Dynamics of Flight (spinning rotors); B. Stevens, F. Lewis and E. Johnson, Aircraft "
        "Control and Simulation",
        "C_m += -2 a Ω r V / q̄, C_n += a Ω q V / q̄, with r = r b/2V, q = q c/V and a in proportion to h / Ω",
        (
            Variant(
                terms={"Cm": ("propeller_speed*r*V/qbar",), "Cn": ("propeller_speed*q*V/qbar",)},
                ties={"Cm": (Tie(0, -2.0),), "Cn": (Tie(0),)},
            ),
        ),
        "Error of C_m in phase with the yaw rate and of C_n in phase with the pitch rate, the larger the slower the "
        "flight.",
        "Pitch and yaw doublets at low speed and high power.",
    ),
    Effect(
        "compressibility",
        "Compressibility",
        AERODYNAMIC,
        "Towards the speed of sound pressure differences on the wing grow with 1 / √(1 - M²), and with them lift "
        "slope, stability and control power. Beyond the critical Mach number shocks add drag and move the neutral "
        "point aft.",
        "J. Anderson, Fundamentals of Aerodynamics (rule of Prandtl and Glauert); J. Roskam, Airplane Design, part VI",
        "C_Z, C_m += (1 / √(1 - M²) - 1) (a α + b δ_e), C_X += a M⁴",
        (
            Variant(
                terms={
                    "CZ": (
                        "(1/sqrt(max(1-mach**2,0.05))-1)*alpha",
                        "(1/sqrt(max(1-mach**2,0.05))-1)*de",
                    ),
                    "Cm": (
                        "(1/sqrt(max(1-mach**2,0.05))-1)*alpha",
                        "(1/sqrt(max(1-mach**2,0.05))-1)*de",
                    ),
                    "CX": ("mach**4",),
                }
            ),
        ),
        "The same manoeuvre has larger answers at high Mach number than dynamic pressure explains.",
        "The same elevator inputs at several Mach numbers above 0.3; invisible below.",
        domain=Domain("mach", low=0.3),
    ),
    Effect(
        "adverse_yaw",
        "Adverse yaw that depends on lift",
        AERODYNAMIC,
        "The down-going aileron raises lift and with it induced drag on its side, which yaws the nose away from the "
        "turn. It grows with the angle of attack, so that one constant C_n,δa is right at one lift only.",
        "B. Etkin and L. Reid, Dynamics of Flight; B. McCormick, Aerodynamics, Aeronautics and Flight Mechanics",
        "C_n += a α δ_a + b δ_a |δ_a|",
        (
            Variant("with lift", {"Cn": ("alpha*da",)}),
            Variant("with lift and deflection", {"Cn": ("alpha*da", "da*abs(da)")}),
        ),
        "Error of C_n in phase with the aileron, the sign turning at some angle of attack.",
        "Aileron doublets with the rudder held, at two speeds.",
    ),
    Effect(
        "dihedral_alpha",
        "Dihedral effect that depends on lift",
        AERODYNAMIC,
        "Sweep, wing tips and the interference of fuselage and wing make the rolling moment of sideslip depend on "
        "lift. C_l,β is then a straight line in the angle of attack and not a constant.",
        "B. Etkin and L. Reid, Dynamics of Flight; J. Roskam, Airplane Design, part VI",
        "C_l += a α β",
        (Variant(terms={"Cl": ("alpha*beta",)}),),
        "Error of C_l in phase with sideslip, of opposite sign at low and at high angle of attack.",
        "Rudder doublets or steady sideslips at several speeds.",
    ),
    Effect(
        "sideslip_drag",
        "Drag of sideslip",
        AERODYNAMIC,
        "Across the flow the fuselage and the fin have more drag, and the side force has a part along the flow, which "
        "grow with the square of a small sideslip and in proportion to a large one. Drag does not depend on the side "
        "from which the air comes.",
        "S. Hoerner, Fluid-Dynamic Drag; B. Stevens, F. Lewis and E. Johnson, Aircraft Control and Simulation",
        "C_X += a β², a |β|, or a β₀ (√(1 + (β/β₀)²) - 1), which is the first below β₀ and the second above",
        (
            Variant("quadratic", {"CX": ("beta**2",)}),
            Variant("linear", {"CX": ("abs(beta)",)}),
            Variant("quadratic, then linear", {"CX": ("{knee}*(sqrt(1+(beta/{knee})**2)-1)",)}),
        ),
        "Error of C_X in sideslips of either sign.",
        "Steady sideslips to both sides, small and large.",
        (ShapeParameter("knee", "rad", 0.01, 0.25, 9),),
    ),
    Effect(
        "sideslip_pitching",
        "Pitching moment of sideslip",
        AERODYNAMIC,
        "In sideslip one half of the tail leaves the downwash or enters the wake of the fuselage, which changes the "
        "pitching moment. It does not depend on the side from which the air comes.",
        "B. Stevens, F. Lewis and E. Johnson, Aircraft Control and Simulation; S. Hoerner, Fluid-Dynamic Lift",
        "C_m += a β² or a |β|",
        (Variant("quadratic", {"Cm": ("beta**2",)}), Variant("linear", {"Cm": ("abs(beta)",)})),
        "Error of C_m in sideslips of either sign.",
        "Steady sideslips to both sides, elevator held.",
    ),
    Effect(
        "control_nonlinearity",
        "Control that is not in proportion to deflection",
        AERODYNAMIC,
        "At large deflections the flow leaves the control surface and its effect grows less than in proportion. Slots "
        "and horns can do the opposite around zero.",
        "J. Roskam, Airplane Design, part VI (plain flaps at large deflections); S. Hoerner, Fluid-Dynamic Lift",
        "C += a C_δ δ³ or a C_δ δ |δ|, with one a in the axes of the surface",
        (
            surface("elevator, cubic", ("Cm", "CZ"), ("de**3",)),
            surface("elevator, quadratic", ("Cm", "CZ"), ("de*abs(de)",)),
            surface("aileron, cubic", ("Cl", "Cn"), ("da**3",)),
            surface("aileron, quadratic", ("Cl", "Cn"), ("da*abs(da)",)),
            surface("rudder, cubic", ("Cn", "CY", "Cl"), ("dr**3",)),
            surface("rudder, quadratic", ("Cn", "CY", "Cl"), ("dr*abs(dr)",)),
        ),
        "Small inputs are under-, large ones over-predicted, the same at every speed.",
        "The same doublet in three sizes, up to the stop.",
    ),
    Effect(
        "free_play",
        "Free play of a control surface",
        AERODYNAMIC,
        "A worn hinge or linkage lets a surface rest while its servo moves by a little, so that small commands about "
        "one deflection do nothing. Large ones arrive less by half the width of the gap.",
        "J. Roskam, Airplane Design, part VI; R. Jategaonkar, Flight Vehicle System Identification",
        "C += a C_δ min(max(δ - δ₀, -g), g), with one share a in the axes of the surface; a = -1 where it rests",
        _of_each_surface(_slack),
        "Small inputs of one surface do nothing, large ones nearly what they should.",
        "Doublets of one surface in three sizes, from the smallest that shows to the largest.",
        (ShapeParameter("gap", "rad", 0.008, 0.056, 4), ShapeParameter("centre", "rad", -0.08, 0.08, 5)),
        share_sign=-1.0,
    ),
    Effect(
        "rate_limit",
        "Servo that reaches its greatest rate",
        AERODYNAMIC,
        "A servo, or hydraulics that are short of flow, moves a surface no faster than at its greatest rate. Small "
        "commands arrive as they are; large ones become ramps, and quick ones are never reached.",
        "R. Jategaonkar, Flight Vehicle System Identification; B. Stevens, F. Lewis and E. Johnson, Aircraft Control "
        "and Simulation",
        "C += a C_δ (δ_R - δ), where δ_R follows δ by no more than R in a second, with one share a in the axes of the "
        "surface; a = 1 where the recorded command is that of the servo",
        _of_each_surface(_late_by_rate),
        "Slow inputs of one surface fit, quick ones come late, and the later the larger they are.",
        "Doublets of one surface in three sizes, as quick as they can be commanded.",
        (ShapeParameter("rate", "rad/s", 0.05, 1.65, 9),),
        share_sign=1.0,
    ),
    Effect(
        "control_effectiveness_alpha",
        "Control power that depends on angle of attack",
        AERODYNAMIC,
        "Towards the stall the flow over ailerons thickens, and tail surfaces enter the wake of wing and fuselage, so "
        "that control power falls with the angle of attack. The sign can be the opposite for an elevator that leaves "
        "the downwash.",
        "V. Klein and E. Morelli, Aircraft System Identification; J. Roskam, Airplane Flight Dynamics and "
        "Automatic Flight Controls",
        "C += a C_δ α δ, with one a in the axes of elevator or rudder; aileron: one in C_l, one in C_n",
        (
            surface("elevator", ("Cm", "CZ"), ("alpha*de",)),
            Variant("aileron", {"Cl": ("alpha*da",), "Cn": ("alpha*da",)}),
            surface("rudder", ("Cn", "CY", "Cl"), ("alpha*dr",)),
            Variant("aileron in roll", {"Cl": ("alpha*da",)}),
        ),
        "Control power right at one speed, too large at lower, too small at higher ones.",
        "The same doublets at low and at high speed.",
    ),
    Effect(
        "asymmetric_thrust",
        "Thrust line beside the centre of gravity",
        AERODYNAMIC,
        "Thrust that does not pass the plane of symmetry, because engines differ or are turned, yaws the aeroplane in "
        "proportion to it. The fin in the swirl of the slipstream looks the same.",
        "J. Roskam, Airplane Flight Dynamics and Automatic Flight Controls; W. Phillips, Mechanics of Flight",
        "C_n += a T_c",
        (Variant("yaw", {"Cn": ("Tc",)}), Variant("yaw and side force", {"Cn": ("Tc",), "CY": ("Tc",)})),
        "Error of C_n that follows the throttle.",
        "Throttle steps with wings level and rudder held.",
    ),
    Effect(
        "landing_gear",
        "Landing gear",
        AERODYNAMIC,
        "A gear that is extended, or a door that opens, adds drag at once. Its drag acts below the centre of gravity "
        "and pitches the nose down.",
        "S. Hoerner, Fluid-Dynamic Drag; J. Roskam, Airplane Design, part VI",
        "C_X, C_m += a for t > t₀",
        (Variant(terms={"CX": (STEP,), "Cm": (STEP,)}),),
        "From some time on constant errors of C_X and C_m, none of C_Z.",
        "Extension and retraction in steady flight.",
        (BEGIN,),
    ),
    Effect(
        "icing",
        "Icing",
        AERODYNAMIC,
        "Ice that grows on the leading edges roughens the wing: drag rises, lift slope and control power fall. It "
        "takes its time, in contrast to damage.",
        "M. Bragg et al., Smart Icing Systems for Aircraft Icing Safety, AIAA 2002-0813: C_iced = (1 + η k) C",
        "C_X, C_Z, C_m += η(t) (a + b α), η(t) = (t - t₀)⁺, or growing to an end; on one wing C_X, C_n += a η, "
        "C_Z, C_l += a η α",
        (
            Variant(
                "growing",
                {
                    "CX": ("max(time-{t0},0)", "max(time-{t0},0)*alpha"),
                    "CZ": ("max(time-{t0},0)*alpha",),
                    "Cm": ("max(time-{t0},0)*alpha",),
                },
            ),
            Variant(
                "settling",
                {
                    "CX": ("(1-exp(-max(time-{t0},0)/30))", "(1-exp(-max(time-{t0},0)/30))*alpha"),
                    "CZ": ("(1-exp(-max(time-{t0},0)/30))*alpha",),
                    "Cm": ("(1-exp(-max(time-{t0},0)/30))*alpha",),
                },
            ),
            _ice_on_one_wing("max(time-{t0},0)", "growing"),
            _ice_on_one_wing("(1-exp(-max(time-{t0},0)/30))", "settling"),
        ),
        "Errors of C_X and C_Z that grow slowly from some time on.",
        "Speed changes and pull-ups, repeated during the flight.",
        (ShapeParameter("t0", "s", 0.0, 0.8, 9, OF_TIME),),
        shows_in=("CX",),
        signs={"CX": -1.0},
    ),
    Effect(
        "lift_nonlinearity",
        "Curved lift and moment",
        AERODYNAMIC,
        "Wings of low aspect ratio gain lift from their tip vortices, which grows with the square of the angle of "
        "attack, and thick boundary layers bend the lift curve well below the stall. The moment curve bends with it.",
        "S. Hoerner, Fluid-Dynamic Lift; V. Klein and E. Morelli, Aircraft System Identification",
        "C_Z, C_m += a α², a α |α| or a α³, this also in C_X",
        (
            Variant("quadratic", {"CZ": ("alpha**2",), "Cm": ("alpha**2",)}),
            Variant("vortex lift", {"CZ": ("alpha*abs(alpha)",), "Cm": ("alpha*abs(alpha)",)}),
            Variant("cubic", {"CZ": ("alpha**3",), "Cm": ("alpha**3",), "CX": ("alpha**3",)}),
        ),
        "Errors of C_Z and C_m of one sign at both ends of the range of α and of the other in its middle.",
        "Pushover and pull-up, slow and fast flight.",
        shows_in=("CZ",),
    ),
    Effect(
        "lift_tilt",
        "Tilt of the lift with angle of attack",
        AERODYNAMIC,
        "Lift is normal to the flow and not to the body, so that α times every part of the lift, of the elevator and "
        "of pitch rate as well, points forward in C_X. A C_X with α² alone knows only the part of the lift that α "
        "makes.",
        "V. Klein and E. Morelli, Aircraft System Identification: C_X = C_L sin α - C_D cos α",
        "C_X += α (a δ_e + b q)",
        (Variant(terms={"CX": ("alpha*de", "alpha*q")}),),
        "Small errors of C_X in quick elevator inputs, of the sign of α times the input.",
        "Elevator inputs at low speed.",
    ),
    Effect(
        "lateral_rates_alpha",
        "Roll and yaw derivatives that depend on lift",
        AERODYNAMIC,
        "A yawing wing has more speed and so more lift on the outer side, and a rolling wing tilts its lift forward "
        "on the down-going side. C_l,r and C_n,p are therefore in proportion to lift and not constant.",
        "B. Etkin and L. Reid, Dynamics of Flight; J. Roskam, Airplane Design, part VI",
        "C_l += α (a r + b p), C_n += α (a p + b r)",
        (Variant(terms={"Cl": ("alpha*r", "alpha*p"), "Cn": ("alpha*p", "alpha*r")}),),
        "Errors of C_l and C_n in rolls and turns, of opposite sign at low and at high angle of attack.",
        "Aileron and rudder doublets at several speeds.",
    ),
    Effect(
        "p_factor",
        "Propeller at an angle to the flow",
        AERODYNAMIC,
        "The blade that goes down meets the air faster when the propeller is inclined, so that thrust acts beside its "
        "axis. It yaws the aeroplane with thrust times angle of attack and pitches it with thrust times sideslip.",
        "W. Phillips, Mechanics of Flight; B. McCormick, Aerodynamics, Aeronautics and Flight Mechanics",
        "C_n += a T_c α, C_m += b T_c β",
        (Variant(terms={"Cn": ("Tc*alpha",), "Cm": ("Tc*beta",)}),),
        "Error of C_n at high power and high angle of attack.",
        "Throttle steps at low and at high speed, sideslips under power.",
    ),
    Effect(
        "aeroelasticity",
        "Bending of wing and tail with dynamic pressure",
        AERODYNAMIC,
        "A wing twists and a fuselage bends under load, so that lift slope and control power change with dynamic "
        "pressure. Ailerons lose power first, up to their reversal.",
        "B. Etkin and L. Reid, Dynamics of Flight; J. Roskam, Airplane Flight Dynamics and Automatic Flight Controls",
        "C += a q̄ α or a q̄ δ",
        (
            Variant("tail", {"Cm": ("qbar*de", "qbar*alpha"), "CZ": ("qbar*alpha",)}),
            Variant("wing and ailerons", {"Cl": ("qbar*da", "qbar*p")}),
            Variant("fin", {"Cn": ("qbar*dr", "qbar*beta")}),
        ),
        "Control power right at one speed and smaller at higher ones.",
        "The same doublets at several speeds.",
    ),
)  # fmt: skip
