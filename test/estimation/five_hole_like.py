"""A problem of the shape of the five-hole probe, (36) to (42) of the two-stage paper, on made-up motion.

Level flight at varied heading, alpha and beta; body rates and the roll and pitch of the wind circles are left out.
xi1: airspeed scale and offset, wind NED. xi2: scale and offset of alpha and of beta, misalignment about x.
"""

import numpy as np

from aircraft_sysid_ros.estimation.two_stage.problem import Problem

NAMES1 = ("scale_v", "offset_v", "w_n", "w_e", "w_d")
NAMES2 = ("scale_alpha", "offset_alpha", "scale_beta", "offset_beta", "roll")
BOUNDS1 = np.array([[-0.5, 0.5], [-5.0, 5.0], [-12.0, 12.0], [-12.0, 12.0], [-4.0, 4.0]])
BOUNDS2 = np.array([[-0.5, 0.5], [-0.1, 0.1], [-0.5, 0.5], [-0.1, 0.1], [-0.26, 0.26]])
NOISE = np.array([0.3, 0.3, 0.2])


def five_hole_like(count, truth, seed=0, *, with_gradient=True):
    """Problem and its truth (10,), measurements with noise; all signals follow from the seed."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 60.0, count)

    def wave(size, *periods):
        sines = sum(np.sin(2.0 * np.pi * t / p + rng.uniform(0, 6.28)) for p in periods)
        return size * sines / len(periods) ** 0.5

    heading, bank, pitch = 2.0 * np.pi * t / 20.0, wave(0.4, 17.0, 9.0), wave(0.15, 11.0, 5.0)
    speed, alpha, beta = 17.0 + wave(2.0, 13.0, 4.0), 0.06 + wave(0.06, 3.0, 7.0), wave(0.08, 2.5, 6.0)
    ch, sh, cb, sb, cp, sp = (f(x) for x in (heading, bank, pitch) for f in (np.cos, np.sin))
    body = np.empty((count, 3, 3))
    body[:, 0] = np.stack([cp * ch, sb * sp * ch - cb * sh, cb * sp * ch + sb * sh], axis=1)
    body[:, 1] = np.stack([cp * sh, sb * sp * sh + cb * ch, cb * sp * sh - sb * ch], axis=1)
    body[:, 2] = np.stack([-sp, sb * cp, cb * cp], axis=1)
    eye = np.broadcast_to(np.eye(3), (count, 3, 3))

    def angles(xi2):
        return (1.0 + xi2[0]) * alpha + xi2[1], (1.0 + xi2[2]) * beta + xi2[3]

    def turned(vector, roll):
        c, s = np.cos(roll), np.sin(roll)
        out = np.stack([vector[0], c * vector[1] + s * vector[2], c * vector[2] - s * vector[1]], axis=1)
        return np.einsum("kij,kj->ki", body, out)

    def direction(xi2):
        a, b = angles(xi2)
        return turned((np.cos(a) * np.cos(b), np.sin(b), np.sin(a) * np.cos(b)), xi2[4])

    def parts(f):
        return np.concatenate([(f * speed[:, None])[:, :, None], f[:, :, None]], axis=2), f * speed[:, None]

    def model(xi2):
        columns, b = parts(direction(xi2))
        return np.concatenate([columns, eye], axis=2), b

    def gradient(xi2):
        a, b = angles(xi2)
        zero = np.zeros_like(a)
        by_a = turned((-np.sin(a) * np.cos(b), zero, np.cos(a) * np.cos(b)), xi2[4])
        by_b = turned((-np.cos(a) * np.sin(b), np.cos(b), -np.sin(a) * np.sin(b)), xi2[4])
        y, z = np.sin(b), np.sin(a) * np.cos(b)
        c, s = np.cos(xi2[4]), np.sin(xi2[4])
        by_roll = np.einsum("kij,kj->ki", body, np.stack([zero, -s * y + c * z, -s * z - c * y], axis=1))
        da, db = np.zeros((count, 3, 5, 5)), np.empty((count, 3, 5))
        for j, f in enumerate((by_a * alpha[:, None], by_a, by_b * beta[:, None], by_b, by_roll)):
            da[:, :, :2, j], db[:, :, j] = parts(f)
        return da, db

    a, b = model(truth[5:])
    measured = a @ truth[:5] + b + rng.normal(size=(count, 3)) * NOISE
    return Problem(measured, model, NAMES1, NAMES2, BOUNDS1, BOUNDS2, gradient if with_gradient else None)
