"""Numbers as people read them: value and error to the same place, and no zero with a sign."""

from __future__ import annotations

import math

import pytest

from aircraft_sysid_ros.rounding import fixed, rounded_to_error, with_error

NAN = float("nan")


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [
        (-0.0937, 0.00097, "-0.09370 ± 0.00097"),  # it was -0.0937 ± 0.00097
        (-0.0937, 0.000996, "-0.0937 ± 0.0010"),
        (3.04, 0.4, "3.04 ± 0.40"),
        (-7.0, 123.0, "-10 ± 120"),
        (1.0, 123.0, "0 ± 120"),
        (-1e-9, 2e-9, "-1.0e-09 ± 2.0e-09"),
        (1e-12, 2e-9, "0.0e+00 ± 2.0e-09"),  # it was 1e-12, a place of which nothing is known
        (2e22, 1e12, "2.00000000000e+22 ± 1.0e+12"),  # it was 20000000000000000000000 ± 1000000000000
        (-16.0, 2e12, "0.0e+00 ± 2.0e+12"),
        (NAN, 0.1, "nan ± 0.10"),
        (NAN, 1e-9, "nan ± 1.0e-09"),  # a traceback, as of an infinite value
        (-math.inf, 1e-9, "-inf ± 1.0e-09"),
        (0.5, NAN, "0.5"),
        (0.5, 0.0, "0.5"),
    ],
)
def test_a_value_ends_where_its_error_does(value, std, words) -> None:
    assert with_error(value, std) == words
    assert with_error(value, std, "+-") == words.replace("±", "+-")


@pytest.mark.parametrize("value", [-0.0, -1e-12])
def test_zero_has_no_sign(value) -> None:
    """A wing was told to bank by -0.00 deg."""
    assert fixed(value, 2) == "0.00" and rounded_to_error(value, 0.1)[0] == "0.00"
    assert rounded_to_error(-0.0, 1e-9)[0] == "0.0e+00" and rounded_to_error(-0.0, NAN)[0] == "0"
