"""Back to the autopilot: the right numbers, not too often, and only what may be used."""

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.back_channel import BackChannel, Known, Wind
from aircraft_sysid_ros.mavlink.back_options import BackOptions
from aircraft_sysid_ros.mavlink.decoder import Decoder
from aircraft_sysid_ros.mavlink.quantities import text

SECOND = 1_000_000_000
BOOT = 12_345_678_000


def through_the_wire(messages):
    return [m for message in messages for m in Decoder().decode(Decoder().encode(message))]


def test_wind_with_its_uncertainty_at_most_as_often_as_asked():
    back = BackChannel(BackOptions(wind_rate=2.0))
    count = 0
    for k in range(100):
        back.wind = Wind((3.0, -2.0, 0.5), (0.09, 0.16, 0.04), 300.0)
        messages = through_the_wire(back.due(k * SECOND // 20, BOOT))
        count += len(messages)
        if k == 0:
            (wind,) = messages
            assert (wind.wind_x, wind.wind_y, wind.wind_z, wind.wind_alt) == (3.0, -2.0, 0.5, 300.0)
            assert wind.horiz_accuracy == pytest.approx(np.sqrt(0.125)) and wind.vert_accuracy == pytest.approx(0.2)
            assert np.isnan(wind.var_horiz)  # of the wind itself nothing is said
            assert wind.time_usec == BOOT // 1000
    assert count == 10
    assert not back.due(100 * SECOND, BOOT) or back.wind is None  # nothing new, nothing sent
    assert not back.due(200 * SECOND, BOOT)


KNOWN = (Known("CZ_alpha", -4.6, 0.05, True), Known("Cm_alpha", -0.7, 0.2, False), Known("CX_0", -0.03, 0.001, True))


def test_named_values_are_those_that_may_be_used():
    back = BackChannel(BackOptions(("CZ_alpha", "Cm_alpha", "Cm_q")))
    back.parameters = KNOWN
    (message,) = through_the_wire(back.due(0, BOOT))
    assert (text(message.name), message.value) == ("CZ_alpha", pytest.approx(-4.6))
    assert message.time_boot_ms == BOOT // 1_000_000


def test_an_array_keeps_the_places_and_has_nan_for_the_rest():
    back = BackChannel(BackOptions(("Cm_alpha", "CZ_alpha", "Cm_q"), form="array"))
    back.parameters = KNOWN
    values, errors = through_the_wire(back.due(0, BOOT))
    assert (values.array_id, errors.array_id, text(values.name)) == (1, 2, "SYSID")
    np.testing.assert_allclose(values.data[:3], [np.nan, -4.6, np.nan], rtol=1e-6)
    np.testing.assert_allclose(errors.data[:3], [np.nan, 0.05, np.nan], rtol=1e-6)
    assert values.data[3:] == [0.0] * 55


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"parameters": ("Cl_alpha*beta", "Cl_alpha*beta**2")}, "begin with 'Cl_alpha*b'"),
        ({"parameters": tuple(f"Cm_p{i}" for i in range(59)), "form": "array"}, "at most 58"),
        ({"parameters": ("Cm_q", "Foo")}, "'Foo' is not a parameter to send back: give an axis and a term"),
        ({"form": "json"}, "one of named or array"),
        ({"wind_rate": 1000.0}, "between 0 and 50 Hz"),
    ],
)
def test_options_that_cannot_be(options, text):
    with pytest.raises(InputError) as refused:
        BackChannel(BackOptions(**options))
    assert text in str(refused.value)
