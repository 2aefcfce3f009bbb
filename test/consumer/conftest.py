"""Contents of messages, as an estimator would send them."""

import numpy as np
import pytest

NAMES = ("Cm_0", "Cm_alpha", "Cm_de")
VALUES = (-0.03, -0.7, -0.85)


@pytest.fixture
def content():
    """Makes the content of a message: three parameters with USE, learnt at 15 to 19 m/s, unless told otherwise."""

    def make(values=VALUES, std=(0.002, 0.02, 0.02), status=(0, 0, 0), names=NAMES, **more):
        root = np.diag(std) @ np.linalg.cholesky(0.8 * np.eye(len(names)) + 0.2)
        found = {
            "model": "abc",
            "parameters": [
                {"name": n, "value": v, "standard_deviation": s, "status": k, "reason": "why" if k else "", "age": 0.5,
                 "excitation": 9.0}
                for n, v, s, k in zip(names, values, std, status, strict=True)
            ],
            "covariance": (root @ root.T).ravel(),
            "airspeed_min": 15.0, "airspeed_max": 19.0, "alpha_min": 0.0, "alpha_max": 0.12,
            "beta_min": -0.1, "beta_max": 0.1,
        }  # fmt: skip
        return {**found, **more}

    return make
