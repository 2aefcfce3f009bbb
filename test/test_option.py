"""Options are declared once: what is said of them everywhere, and what a bad value is told."""

from dataclasses import asdict, replace
from typing import Literal, get_args

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.estimators.by_name import ESTIMATORS
from aircraft_sysid_ros.identification.options import EstimatorName, ParameterOptions
from aircraft_sysid_ros.option import Option, OptionError, option, options, options_of
from aircraft_sysid_ros.reconstruction.options import StateOptions


@options
class Example:
    """One option of each kind."""

    wait: float = option(0.5, "How long to wait.", "s", 0.0, 5.0)
    count: int = option(3, "How often.", "", 1, 9)
    form: Literal["long", "short", "none"] = option("long", "Which form.", fixed="it is printed")
    loud: bool = option(False, "Say it.")


def test_what_is_declared_is_read_back() -> None:
    found = options_of(Example)
    assert found["wait"] == Option(0.5, "How long to wait.", "s", 0.0, 5.0)
    assert found["form"] == Option("long", "Which form.", choices=("long", "short", "none"), fixed="it is printed")
    assert found["wait"].text == "How long to wait. Unit: s."
    assert asdict(Example()) == {name: each.default for name, each in found.items()}


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"wait": 7}, "wait must be between 0 and 5 s, not 7"),
        ({"wait": -1.0}, "wait must be between 0 and 5 s, not -1"),
        ({"wait": float("nan")}, "wait must be between 0 and 5 s, not nan"),
        ({"wait": float("inf")}, "wait must be between 0 and 5 s, not inf"),
        ({"wait": "1"}, "wait must be between 0 and 5 s, not '1'"),
        ({"wait": True}, "wait must be between 0 and 5 s, not true"),
        ({"count": 2.5}, "count must be between 1 and 9, not 2.5"),
        ({"form": "wide"}, "form must be one of long, short or none, not 'wide'"),
        ({"loud": 1}, "loud must be true or false, not 1"),
        ({"wiat": 1.0}, "wiat is not an option: known are wait, count, form, loud"),
    ],
)
def test_a_bad_value_is_one_sentence(values, sentence) -> None:
    with pytest.raises(InputError) as error:
        Example(**values)
    assert str(error.value) == sentence


def test_options_cannot_change_and_copies_are_checked() -> None:
    example = Example(wait=1)
    assert isinstance(example.wait, float) and example == replace(Example(), wait=np.float64(1.0))
    with pytest.raises(AttributeError):
        example.wait = 2.0
    with pytest.raises(OptionError, match="wait must be between"):
        replace(example, wait=6.0)


@pytest.mark.parametrize("kind", [StateOptions, ParameterOptions])
def test_every_option_has_a_sentence_and_numbers_have_a_range(kind) -> None:
    for name, each in options_of(kind).items():
        assert each.sentence.endswith(".") and "[" not in each.sentence, name
        if not isinstance(each.default, bool | str):
            assert each.low <= each.default <= each.high and (each.unit or isinstance(each.default, int)), name


def test_a_band_of_frequencies_rises() -> None:
    with pytest.raises(InputError, match="lowest_frequency must be below highest_frequency"):
        ParameterOptions(lowest_frequency=3.0)


def test_every_estimator_can_be_chosen() -> None:
    assert get_args(EstimatorName) == tuple(ESTIMATORS)
