"""The jet of jet.py in 25 to 45 minutes of trimmed flight with a minute or two of manoeuvres: what changed its trim?

    python benchmarks/trimmed_jet.py [--seeds 401 402 …] [--jobs 2]

Steady flight at one speed after another, the speeds of each flight drawn; some doublets in the middle or at the end.
What no aircraft file says moves the trim in all of them: a moment of the thrust, of the speed (flexible tail), a centre
of gravity that fuel moves, a mass that falls. In a third of the flights that is all, in a third a passenger walks
forward and back for some minutes, in a third the flaps go out by 10 degrees and in again, or the gear. Thrust is
recorded in half of them. Recorded at 10 Hz with one vane as in jet.py; the aircraft file holds mass and shape. Each
flight is a line in results/trimmed_jet.jsonl; a run that is stopped goes on where it was.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from jet import COLUMNS, ORDER, Jet, fly_all, said_of

RESULTS = Path(__file__).parent / "results" / "trimmed_jet.jsonl"
KINDS = ("clean", "cg_shift", "configuration")


class TrimmedJet(Jet):
    """The truth of one flight."""

    leg = 60.0

    def __init__(self, kind: str, seed: int) -> None:
        draw = np.random.default_rng([seed, 1])
        self.duration = float(draw.uniform(1500.0, 2700.0))
        super().__init__(kind, seed)
        legs = round(self.duration / self.leg) + 1
        steps = np.clip(np.cumsum(draw.choice([-10.0, 0.0, 0.0, 10.0], legs)), -15.0, 20.0)
        self.speeds = 98.0 + steps
        self.banks = draw.choice([0.0, 0.0, 0.0, 0.0, 0.3, -0.3], legs)
        begin = self.duration * draw.uniform(0.2, 0.6)
        self.span = (begin, begin + draw.uniform(120.0, 480.0))
        self.gear = bool(draw.random() < 0.5)
        self.of_thrust, self.of_speed = draw.uniform(-0.03, 0.03), draw.uniform(-0.008, 0.008)
        self.of_fuel = draw.uniform(-0.02, 0.02)  # [m] that the centre of gravity moves in the flight
        self.burnt = draw.uniform(0.02, 0.06)
        self.gusts = self._gusts(draw.uniform(0.0, 0.4))
        first = self.duration * draw.uniform(0.3, 0.9) - 60.0
        times = first + np.cumsum(draw.uniform(8.0, 14.0, draw.integers(5, 10)))
        self.events = [
            (float(t), ORDER[i % len(ORDER)], str(draw.choice(["doublet", "3211"]))) for i, t in enumerate(times)
        ]
        if draw.random() < 0.5:
            self.columns = {name: column for name, column in COLUMNS.items() if name != "thrust"}

    def coefficients(self, time, air, rates, controls):  # type: ignore[no-untyped-def]
        kind, self.kind = self.kind, ""
        c = super().coefficients(time, air, rates, controls)
        self.kind = kind
        c[4] += self.of_thrust * air[4] + self.of_speed * (air[0] - 98.0) / 20.0
        shift = self.of_fuel * time / self.duration
        inside = self.span[0] <= time < self.span[1]
        if inside and kind == "cg_shift":
            shift += self.shift
        if inside and kind == "configuration":
            c += [-0.018, 0, 0, 0, -0.012, 0] if self.gear else [-0.012, 0, -0.25, 0, -0.02, 0]
        c[4] += shift / self.chord * c[2]
        c[5] -= shift / self.wing_span * c[1]
        return c * (1.0 + self.burnt * time / self.duration * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))


def judged(seed: int) -> dict[str, Any]:
    """One flight."""
    jet = TrimmedJet(KINDS[seed % len(KINDS)], seed)
    about = {"seed": seed, "kind": jet.kind, "span": jet.span, "shift": jet.shift, "gear": jet.gear}
    return {**about, "duration": jet.duration, "thrust": "thrust" in jet.columns, **said_of(jet)}


if __name__ == "__main__":
    fly_all(judged, __doc__, RESULTS, range(400, 424))
