"""A transport that is stalled slowly, at 25 Hz: is the memory of the flow found, and nothing where it is not stalled?

    python benchmarks/stalls.py [--seeds 300 301 …] [--jobs 2]

Equations of motion of jet.py, another aeroplane: lift by Kirchhoff with the point of separation as a state of its own
(Goman and Khrabrov), drag and a nose-down moment of the flow that is separated. Slow decelerations at idle with small
elevator inputs, a recovery, doublets of all surfaces between them. Recorded at 25 Hz, two vanes, attitude, with GPS in
every second flight, two decelerations or four; the aircraft file holds mass and shape. Of every three seeds one flight
is recovered before the flow separates (clean), two go through stalls. Each flight is a line in results/stalls.jsonl; a
run that is stopped goes on where it was.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from jet import COLUMNS, GRAVITY, STEP, WIND, Jet, fly_all, input_of, matrix_of, said_of

RESULTS = Path(__file__).parent / "results" / "stalls.jsonl"
KINDS = ("clean", "stall", "stall")
#: Time between two decelerations [s].
CYCLE = 75.0
_GPS = ("lat", "lon", "gps_alt", "vn", "ve", "vd")
_WITH_SIDESLIP = {**COLUMNS, "ssa": ("sideslip", "deg", 0.1, 0.0, 0.0)}
_SURFACES = ("elevator", "aileron", "rudder")


class Transport(Jet):
    """The truth of one flight with stalls."""

    name, mass, area, chord, wing_span = "transport", 17600.0, 64.0, 3.159, 21.5
    inertia_of = (0.015, 1.7, 0.048, 0.002)
    height, speed, density = 4500.0, 92.0, 0.777
    every, duration = 2, 300.0

    def __init__(self, kind: str, seed: int) -> None:
        self.duration = 150.0 if seed % 4 < 2 else 300.0
        super().__init__(kind, seed)
        draw = self.random.uniform
        self.steepness, self.onset = draw(18.0, 30.0), draw(0.21, 0.25)
        self.time_constant, self.delay = draw(8.0, 20.0) * self.chord, draw(2.0, 6.0) * self.chord
        self.attached, self.recovering = 1.0, False
        self.columns = {k: v for k, v in _WITH_SIDESLIP.items() if k not in _GPS or seed % 2}

    def advance(self, speed: float, alpha: float, alpha_dot: float) -> None:
        """The point of separation follows the angle of attack, late."""
        late = alpha - self.delay / speed * alpha_dot
        steady = 0.5 * (1.0 - np.tanh(self.steepness * (late - self.onset)))
        self.attached += (steady - self.attached) * STEP * speed / self.time_constant

    def coefficients(self, time, air, rates, controls):  # type: ignore[no-untyped-def]
        speed, alpha, beta, _, tc = air
        p, r = rates[0] * self.wing_span / (2.0 * speed), rates[2] * self.wing_span / (2.0 * speed)
        q, (de, da, dr) = rates[1] * self.chord / speed, controls
        lift = 0.25 + 5.1 * 0.25 * (1.0 + np.sqrt(self.attached)) ** 2 * alpha + 4.0 * q + 0.35 * de
        drag = 0.035 + 0.055 * lift**2 + 0.09 * (1.0 - self.attached)
        return np.array([
            lift * np.sin(alpha) - drag * np.cos(alpha),
            -0.9 * beta - 0.05 * p + 0.5 * r + 0.25 * dr,
            -lift * np.cos(alpha) - drag * np.sin(alpha),
            -0.12 * beta - 0.55 * p + 0.2 * r - 0.15 * da + 0.03 * dr,
            0.09 - 0.85 * alpha - 16.0 * q - 1.25 * de - 0.06 * (1.0 - self.attached) + 0.02 * tc,
            0.13 * beta - 0.07 * p - 0.2 * r - 0.008 * da - 0.11 * dr,
        ])  # fmt: skip

    def pilot(self, time, x, speed, integral):  # type: ignore[no-untyped-def]
        """At idle the nose is held up until the flow has separated, or shortly before; then down, with thrust."""
        turn = matrix_of(x[6:10])
        bank, pitch = np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0])
        u, _, w = x[:3] - turn.T @ WIND
        alpha, since = np.arctan2(w, u), time % CYCLE
        below, climb = self.height + x[12], -(turn @ x[:3])[2]
        top = self.onset + 0.06 if self.kind == "stall" else self.onset - 0.07
        slow = since > 30.0 and not self.recovering
        if slow and alpha > top:
            self.recovering = True
        if since < 30.0:
            self.recovering = False
        wanted = float(np.clip(0.002 * below - 0.012 * climb + integral, -0.15, 0.45 if slow else 0.2))
        if self.recovering and since < 70.0 and speed < self.speed - 5.0:
            wanted = -0.05
        else:
            integral += STEP * (0.0002 * below - 0.001 * climb)
        command_of = {
            "elevator": -0.8 * (wanted - pitch) + 1.2 * x[4] - 0.02,
            "aileron": -0.5 * (0.0 - bank) + 0.25 * x[3],
            "rudder": 0.6 * (x[5] - GRAVITY / speed * np.sin(bank)),
        }
        if slow:
            command_of["elevator"] += np.radians(1.0) * np.sign(np.sin(2.0 * np.pi * time / 3.0))
        for k, surface in enumerate(_SURFACES):
            if 4.0 + 8.0 * k <= since < 10.0 + 8.0 * k:
                shape = "3211" if surface == "elevator" else "doublet"
                size = np.radians(1.5 if surface == "elevator" else 3.0)
                command_of[surface] += size * input_of(shape, since - 4.0 - 8.0 * k)
        thrust = 3000.0 if slow else 17000.0 + 4000.0 * (self.speed - speed)
        return np.append(np.clip(list(command_of.values()), -0.4, 0.4), np.clip(thrust, 1500.0, 60000.0)), integral


def judged(seed: int) -> dict[str, Any]:
    """One flight."""
    flight = Transport(KINDS[seed % len(KINDS)], seed)
    return {"seed": seed, "kind": flight.kind, "gps": "vn" in flight.columns, **said_of(flight)}


if __name__ == "__main__":
    fly_all(judged, __doc__, RESULTS, range(300, 306))
