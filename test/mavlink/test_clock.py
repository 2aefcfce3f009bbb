"""The autopilot's clock in ours: laws that hold whatever the link does."""

import numpy as np
import pytest

from aircraft_sysid_ros.mavlink.clock import AutopilotClock, BootTime

SECOND = 1_000_000_000
NOW = 1_760_000_000 * SECOND
DRIFT = 80e-6


class Pair:
    """Two clocks and a link: our time in s from NOW, the other's with offset and drift."""

    def __init__(self, seed=0, offset=123.4, drift=DRIFT):
        self.rng = np.random.default_rng(seed)
        self.offset, self.drift = offset, drift

    def local(self, t):
        return NOW + round(t * SECOND)

    def remote(self, t):
        return round((self.offset + t * (1.0 + self.drift)) * SECOND)

    def exchange(self, clock, t, up, down):
        clock.add_round_trip(self.local(t), self.local(t + up + down), self.remote(t + up))

    def error(self, clock, t):
        return (clock.to_local(self.remote(t)) - self.local(t)) / SECOND


@pytest.mark.parametrize("seed", range(3))
def test_offset_and_drift_are_found_on_a_link_with_jitter(seed):
    pair, clock = Pair(seed), AutopilotClock()
    for k in range(300):
        pair.exchange(clock, float(k), *(0.003 + pair.rng.exponential(0.01, 2)))
    assert abs(pair.error(clock, 300.0)) < 2e-3
    assert abs(pair.error(clock, 300.0)) < 4.0 * clock.std + 1e-4
    assert clock.drift == pytest.approx(-DRIFT, abs=15e-6)
    assert abs(clock.to_remote(clock.to_local(pair.remote(290.0))) - pair.remote(290.0)) <= 2


def test_a_few_quick_answers_outweigh_many_slow_ones_that_are_slow_one_way():
    """What a mean would get wrong by 50 ms: answers that queue for 0.1 s on their way down."""
    pair, clock = Pair(), AutopilotClock()
    for k in range(120):
        down = 0.002 if k % 10 == 0 else 0.1
        pair.exchange(clock, float(k), 0.002, down)
    assert abs(pair.error(clock, 120.0)) < 3e-3


def test_without_answers_the_least_delay_is_taken():
    pair, clock = Pair(), AutopilotClock()
    for k in range(3000):
        t = 0.02 * k
        delay = 0.004 + pair.rng.exponential(0.02)
        clock.add_one_way(pair.remote(t), pair.local(t + delay))
    assert 0.002 < pair.error(clock, 60.0) < 0.012  # late by the least delay, which nobody can see


def test_messages_that_wait_for_longer_than_answers_may_move_no_clock():
    """A busy machine reads for half a minute what is two seconds old: nothing says that the clock has leapt."""
    pair, clock = Pair(), AutopilotClock()
    for k in range(20):
        pair.exchange(clock, float(k), 0.003, 0.003)
    for k in range(1500):
        t = 20.0 + 0.02 * k
        clock.add_one_way(pair.remote(t), pair.local(t + 2.0 + pair.rng.exponential(0.02)))
    assert clock.ready and clock.resets == 0 and abs(pair.error(clock, 50.0)) < 5e-3
    pair.offset += 5.0  # what is earlier than ever is no delay
    for k in range(500):
        t = 50.0 + 0.02 * k
        clock.add_one_way(pair.remote(t), pair.local(t + 0.01))
    assert clock.resets == 1 and abs(pair.error(clock, 60.0)) < 0.02


def test_nothing_is_stamped_before_the_clock_is_known():
    pair, clock = Pair(), AutopilotClock()
    assert clock.to_local(pair.remote(0.0)) is None and clock.to_remote(NOW) is None
    for k in range(2):
        pair.exchange(clock, 0.2 * k, 0.01, 0.01)
        assert not clock.ready
    pair.exchange(clock, 0.6, 0.01, 0.01)
    assert clock.ready


def test_one_wrong_answer_is_left_out_and_a_clock_that_leapt_is_followed():
    pair, clock = Pair(), AutopilotClock()
    for k in range(30):
        pair.exchange(clock, float(k), 0.003, 0.003)
    clock.add_round_trip(pair.local(30.0), pair.local(30.006), pair.remote(30.0) + 7 * SECOND)
    assert abs(pair.error(clock, 31.0)) < 1e-3
    pair.offset += 5.0
    for k in range(31, 50):
        pair.exchange(clock, float(k), 0.003, 0.003)
    assert clock.resets == 1
    assert abs(pair.error(clock, 50.0)) < 1e-3


def test_an_answer_from_before_or_after_a_second_says_nothing():
    clock = AutopilotClock()
    clock.add_round_trip(NOW, NOW - 1, 5)
    clock.add_round_trip(NOW, NOW + 2 * SECOND, 5)
    assert clock.std == np.inf


# -- the time since start that messages carry ------------------------------------------------------------------


def test_the_32_bits_of_servo_outputs_wrap_after_71_minutes():
    boot = BootTime()
    start = 2**32 * 1000 - 2 * SECOND + 500_000  # [ns] two seconds before
    for k in range(40):
        t = start + k * SECOND // 10
        assert boot.of("ATTITUDE", {"time_boot_ms": t // 1_000_000}, NOW + t) == t // 1_000_000 * 1_000_000
        found = boot.of("SERVO_OUTPUT_RAW", {"time_usec": (t // 1000) % 2**32}, NOW + t)
        assert found == t // 1000 * 1000
    assert boot.reboots == 0


def test_ardupilots_flow_angles_wrap_too_though_their_field_is_wide():
    boot, start = BootTime(), 2**32 * 1000 - SECOND + 500_000
    for k in range(100):
        t = start + k * SECOND // 50
        boot.of("ATTITUDE", {"time_boot_ms": t // 1_000_000}, NOW + t)
        for _ in range(2):  # two in a row must not look like a restart
            assert boot.of("AOA_SSA", {"time_usec": (t // 1000) % 2**32}, NOW + t) == t // 1000 * 1000
    assert boot.reboots == 0


def heard_with_servos(boot, start, begin, seconds):
    """Share of IMU messages and of servo outputs that get their time; the servo outputs come first of each two."""
    right = {"HIGHRES_IMU": [], "SERVO_OUTPUT_RAW": []}
    for k in range(100 * seconds):
        t, at = start + k * SECOND // 100, begin + k * SECOND // 100
        for name, wrap in (("SERVO_OUTPUT_RAW", 2**32), ("HIGHRES_IMU", 2**64)):
            right[name].append(boot.of(name, {"time_usec": t // 1000 % wrap}, at) == t // 1000 * 1000)
    return [np.mean(found) for found in right.values()]


@pytest.mark.parametrize("minutes", [1, 40, 80, 150])
def test_a_bridge_that_is_started_in_flight_knows_the_time_whatever_comes_first(minutes):
    """After 71 minutes servo outputs tell a time that has wrapped: where they came first, nothing else was believed."""
    assert min(heard_with_servos(BootTime(), minutes * 60 * SECOND, NOW, 5)) > 0.99


@pytest.mark.parametrize("minutes", [1, 30, 40, 60, 71.6, 80, 150])
def test_a_restart_is_followed_however_long_the_autopilot_was_up(minutes):
    """From 36 minutes on the servo outputs seemed to go on, and with them no restart was ever believed."""
    boot, up = BootTime(), round(minutes * 60) * SECOND
    heard_with_servos(boot, up, NOW, 2)
    shares = heard_with_servos(boot, 3 * SECOND, NOW + 10 * SECOND, 10)
    assert boot.reboots == 1 and min(shares) > 0.7


def test_the_time_of_the_last_fix_is_no_restart_once_there_is_none():
    """GPS lost for a minute: GPS_RAW_INT goes on with the time of its last fix."""
    boot = BootTime()
    for k in range(60):
        now = (100 + k) * SECOND
        assert boot.of("SYSTEM_TIME", {"time_boot_ms": now // 1_000_000, "time_unix_usec": 0}, NOW + now) == now
        for _ in range(2):
            assert boot.of("GPS_RAW_INT", {"time_usec": 100_000_000, "fix_type": 1}, NOW + now) == now
    assert boot.reboots == 0


def test_a_fix_that_is_told_again_is_known_by_its_time():
    boot = BootTime()
    told = [boot.is_repeated("GPS_RAW_INT", time) for time in (100, 100, 300, 300, 300, 500)]
    assert told == [False, True, False, True, True, False]
    assert not boot.is_repeated("ATTITUDE", 500) and not boot.is_repeated("ATTITUDE", 500)


def test_unix_time_becomes_time_since_start_by_system_time():
    boot = BootTime()
    unix = 1_760_000_000_000_000
    assert boot.of("HIGHRES_IMU", {"time_usec": unix}, NOW) is None
    boot.of("SYSTEM_TIME", {"time_unix_usec": unix, "time_boot_ms": 5000}, NOW)
    assert boot.of("HIGHRES_IMU", {"time_usec": unix + 10_000}, NOW + SECOND // 100) == 5_010_000_000


def test_a_message_without_a_time_gets_that_of_the_one_before():
    boot = BootTime()
    assert boot.of("VFR_HUD", {}, NOW) is None
    boot.of("ATTITUDE", {"time_boot_ms": 4000}, NOW)
    assert boot.of("VFR_HUD", {}, NOW) == 4 * SECOND


def test_one_wild_time_is_dropped_and_a_restart_is_followed():
    boot = BootTime()
    for k in range(10):
        boot.of("ATTITUDE", {"time_boot_ms": 100_000 + 100 * k}, NOW + k * SECOND // 10)
    at = NOW + SECOND
    assert boot.of("ATTITUDE", {"time_boot_ms": 4_000_000_000}, at) is None
    assert boot.of("ATTITUDE", {"time_boot_ms": 101_000}, at) == 101 * SECOND
    assert boot.reboots == 0
    at += 3 * SECOND
    for ms in range(2000, 2500, 100):  # not yet believed
        assert boot.of("ATTITUDE", {"time_boot_ms": ms}, at + (ms - 2000) * 1_000_000) is None
    assert boot.of("ATTITUDE", {"time_boot_ms": 2500}, at + SECOND // 2) == 2_500_000_000
    assert boot.reboots == 1


def test_a_restart_is_followed_though_its_messages_waited_with_those_before_it():
    """A reader that stood still for a minute hears the old time a moment before the new one, which is up for 40 s."""
    boot = BootTime()
    boot.of("ATTITUDE", {"time_boot_ms": 100_000}, NOW)
    for k in range(100):
        told = [boot.of("ATTITUDE", {"time_boot_ms": 40_000 + 30 * k}, NOW + k * 3 * SECOND // 100)]
    assert boot.reboots == 1 and told == [42_970_000_000]


def test_forged_times_among_the_genuine_are_no_restart():
    """Two of them used to shut out 200 IMU messages; now as many as the genuine ones do no harm."""
    boot, forged = BootTime(), 0
    for k in range(1000):
        at = NOW + k * SECOND // 100
        assert boot.of("HIGHRES_IMU", {"time_usec": 50_000_000 + 10_000 * k}, at) is not None
        for _ in range(20):  # in one packet, agreeing with each other
            forged += boot.of("HIGHRES_IMU", {"time_usec": 900_000_000 + 10_000 * k}, at + 1000) is not None
        stale = {"time_boot_ms": 1000 + 10 * k, "time_unix_usec": 10**15 + 1}
        forged += boot.of("SYSTEM_TIME", stale, at + 2000) is not None
    assert (boot.reboots, forged) == (0, 0)
    assert (
        boot.of("GPS_RAW_INT", {"time_usec": 10**15 + 10**7, "fix_type": 3}, at) == 59_990_000_000
    )  # no Unix time was believed


@pytest.mark.parametrize("behind", [2, 4, 9])
def test_an_autopilot_that_is_behind_with_its_samples_has_not_started_anew(behind):
    """It tells the time each second: what was taken before that is late. 14 restarts were told of one that was not."""
    boot, passed = BootTime(), 0
    for k in range(3000):
        now = 100 * SECOND + k * SECOND // 100
        if k % 100 == 0:
            assert boot.of("SYSTEM_TIME", {"time_boot_ms": now // 1_000_000, "time_unix_usec": 0}, NOW + now) == now
        taken = now - min(k / 1000, 1.0) * behind * SECOND  # it falls behind within ten seconds
        passed += boot.of("HIGHRES_IMU", {"time_usec": int(taken) // 1000}, NOW + now) is not None
    assert boot.reboots == 0
    assert passed == 3000 if behind < 5 else passed > 500


def test_packets_that_change_places_are_no_restart():
    boot = BootTime()
    for ms in (5000, 5030, 5010, 5050, 5020):
        assert boot.of("ATTITUDE", {"time_boot_ms": ms}, NOW + ms * 1_000_000) == ms * 1_000_000
    assert boot.reboots == 0


def test_messages_that_waited_in_a_queue_are_no_restart():
    """A serial port or TCP that was stuck for 30 s gives all at once."""
    boot = BootTime()
    boot.of("ATTITUDE", {"time_boot_ms": 1000}, NOW)
    for k in range(300):
        assert boot.of("ATTITUDE", {"time_boot_ms": 1100 + 100 * k}, NOW + 31 * SECOND) is not None
    assert boot.reboots == 0


def test_a_reader_that_is_behind_until_its_queue_is_full_hears_no_restart():
    """What waited comes later and later, and then what was sent 8 s after it: five restarts were told of that."""
    boot, delay = BootTime(), 0.0
    for k in range(6000):
        delay = delay + 0.006 if delay < 8.0 else 0.0
        if delay > 4.0 and (k // 100) % 2:
            continue  # there was no room for it
        at = NOW + round((0.01 * k + delay) * SECOND)
        assert boot.of("HIGHRES_IMU", {"time_usec": 50_000_000 + 10_000 * k}, at) is not None
    sent = 110_000_000
    for gap in (0, 8_000_000, 20_000_000):
        sent += gap
        assert boot.of("HIGHRES_IMU", {"time_usec": sent}, NOW + 100 * SECOND + sent) is not None
    assert boot.reboots == 0
