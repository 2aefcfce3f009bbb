"""Node of the first step: sensor topics in, reconstructed state and wind out."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from aircraft_sysid_msgs.msg import AircraftState
from aircraft_sysid_msgs.srv import Reset
from geometry_msgs.msg import TransformStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Odometry

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.calibration.filter_start import start_of_calibration
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_check import in_flight
from aircraft_sysid_ros.flight_check.in_flight import watch_of
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.estimator_node import PROBE_TOPIC, EstimatorNode
from aircraft_sysid_ros.nodes.options import NodeOption, When, node_options, options_from
from aircraft_sysid_ros.nodes.sample_rates import SampleRates
from aircraft_sysid_ros.reconstruction.found_noise import found_noise, found_wind_walk
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state import STATUS_TEXT, StateField, status_text
from aircraft_sysid_ros.reconstruction.state_estimator import BESIDE, StateEstimator, warm_up
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, message_fields, to_samples
from aircraft_sysid_ros.ros_messages.output_messages import (
    BASE,
    MAP,
    MAP_NED,
    knows_wind,
    odometry_content,
    state_fields,
    wind_fields,
)
from aircraft_sysid_ros.samples import Kind, Samples, concatenate
from aircraft_sysid_ros.stamps import NANOSECONDS, nanoseconds

IMU_TOPIC = "imu/data"
INPUTS = (IMU_TOPIC, "imu/mag", "gps/fix", "gps/vel", "air_data")
#: Heard by the check between sensors alone: what moves the surfaces; kept by the second step.
CONTROLS_TOPIC = "control_surfaces"
#: Type of /tf; its package is no requirement.
TRANSFORMS = "tf2_msgs/msg/TFMessage"


def _check_transforms(wanted: bool) -> None:
    if wanted:
        try:
            common.message_class(TRANSFORMS)
        except ImportError:
            raise InputError(
                "publish_tf needs tf2_msgs, which is not in this environment: install ros-jazzy-tf2-msgs, "
                "or leave publish_tf false; `~/odometry` holds the same"
            ) from None


OPTIONS = {
    **node_options(StateOptions),
    "publish_tf": NodeOption(
        False,
        "Also send the pose of `~/odometry` to /tf, as map to base_link; needs tf2_msgs.",
        fixed="listeners to /tf would lose the frame",
        when=When.CONFIGURED,
        check=_check_transforms,
    ),
}
#: Samples are pushed together that came within this part of the horizon, by which states are late anyway: one push
#: costs nearly the same for one sample as for ten. The numbers do not depend on it.
TOGETHER = 0.02
_MOST_TOGETHER = 100
#: Time [s] without the IMU after which it is said to be silent.
SILENT = 5.0


class StateEstimatorNode(EstimatorNode):
    """Lifecycle node that owns a StateEstimator while it is configured."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("state_estimator", INPUTS, OPTIONS, **arguments)
        self.rows_published = 0
        self._has_told = False  # of this flight, that the first state is there
        self._had_place = False  # in this flight: positions are those in a map
        self.on_rows: Callable[[Any], None] | None = None  # `live --out` keeps the rows for the run folder
        self.on_samples: Callable[[Any], None] | None = None  # and the samples
        self.on_states: Callable[[Any, Any], None] | None = None  # rows and stamps [ns], after they were published
        self._waiting: list[Samples] = []
        self._rates = SampleRates()
        self._pushed_until = 0  # newest IMU stamp [ns] at the last push
        self._imu_came = self._usable_came = 0.0  # [s] newest samples of the IMU, any and usable, or the activation
        self._usable = 0  # samples of the IMU, at the last look

    def make_estimator(self, aircraft: Aircraft, values: Mapping[str, Any]) -> StateEstimator:
        """The filter, compiled."""
        probe = (PROBE_TOPIC,) if self.correction is not None and self.correction.uses_probe else ()
        moved = (CONTROLS_TOPIC, INPUTS_TOPIC) if aircraft.inputs else (CONTROLS_TOPIC,)
        self.received = dict.fromkeys(INPUTS + probe + moved, 0)
        self._waiting.clear()
        self._rates, self._has_told, self._had_place = SampleRates(), False, False
        warm_up(aircraft)
        in_flight.warm_up()
        return self._started(aircraft, options_from(StateOptions, values))

    def use_options(self, values: Mapping[str, Any]) -> None:
        """Fuse with other options from the next sample on; what came before is fused with the old ones."""
        if self.estimator is not None:
            self._survive(self._push)
            self.estimator.change_options(options_from(StateOptions, values))

    def _started(self, aircraft: Aircraft, options: StateOptions) -> StateEstimator:
        """The filter, watched, and told what the calibration says of the air data."""
        self.check = watch_of(aircraft, options)
        estimator = StateEstimator(aircraft, options, watch=self.check)
        if self.correction is not None and estimator.options.air_data_errors:
            estimator.take_start(start_of_calibration(self.correction.calibration))
        return estimator

    def offer(self) -> None:
        """State, wind, odometry, reset."""
        self._state_publisher = self.publisher(AircraftState, "~/state", common.state_quality())
        self._wind_publisher = self.publisher(TwistWithCovarianceStamped, "~/wind", 10)
        self._odometry_publisher = self.publisher(Odometry, "~/odometry", 10)
        self._transforms = None
        if self.get_parameter("publish_tf").value:
            self._transforms = self.publisher(common.message_class(TRANSFORMS), "/tf", 100)
        self.service(Reset, "~/reset", self._on_reset)

    def activate(self) -> None:
        """Listen."""
        self._imu_came = self._usable_came = time.monotonic()
        super().activate()

    def take(self, topic: str, message: Any) -> None:
        """One sensor message: convert and, when it is time, push and publish the states that are complete."""
        if topic == IMU_TOPIC:
            self._imu_came = time.monotonic()
        samples = to_samples(topic, *message_fields(topic, message), self.estimator.aircraft.inputs)
        if self.correction is not None:
            samples = [left for part in samples if len(left := self.correction.apply(part))]
        self._waiting.extend(samples)
        self._rates.add(samples)
        newest = int(samples[0].stamp[0]) if samples and samples[0].kind[0] == Kind.IMU else self._pushed_until
        period = TOGETHER * self.estimator.options.horizon * NANOSECONDS
        is_due = newest != self._pushed_until and not 0 <= newest - self._pushed_until < period  # or the clock leapt
        if is_due or len(self._waiting) >= _MOST_TOGETHER:
            self._pushed_until = newest
            self._push()

    def finish(self) -> None:
        """Publish the states that still wait for late samples."""
        if self.estimator is not None:
            self._push()
            self._publish(self.estimator.flush())

    def begin_anew(self) -> None:
        """Forget state, biases and wind; the flight goes on."""
        before = self.estimator
        self.estimator = self._started(before.aircraft, before.options)
        self.estimator.follow(before)

    @property
    def flown(self) -> float:
        """Time of flight [s] by the IMU."""
        return float(self.estimator.flight_time)

    def condition(self) -> tuple[str, dict[str, Any]]:
        """What the state rests on, and what became of every sample."""
        self._push()
        values: dict[str, Any] = {}
        for kind, counts in self.estimator.counts().items():
            values.update({f"{kind}.{name}": n for name, n in counts.items() if n})
        values |= self._rates.read()
        for each in found_noise(self.estimator):
            values[f"noise.{each.name}"] = f"{' '.join(f'{value:.3g}' for value in each.in_use)} ({each.source})"
        walk, source = found_wind_walk(self.estimator)
        values["noise.wind"] = f"{walk:.3g} ({source})"
        values["realignments"] = self.estimator.realignments
        order = self.estimator.order.counts
        values["restarts"] = order.restarts
        values["state_listeners"] = self._state_publisher.get_subscription_count()
        status = self._silence_in_words() or STATUS_TEXT[self.estimator.status]
        clocks = order.stamps_in_words, self.estimator.imu_in_words, order.gps_in_words, order.ahead_in_words
        words = [*self.check.words, *clocks, status]
        return "; ".join(filter(None, words)), values

    def _silence_in_words(self) -> str:
        """That the IMU, without which there is no state, has never come, or comes no more; empty: it comes."""
        silent = next((heard for heard in self.inputs if heard.topic == IMU_TOPIC), None)
        if silent is None:
            return ""
        topic, now, counts = silent.subscription.topic_name, time.monotonic(), self.estimator.order.counts
        if (usable := int(counts.received[Kind.IMU] - counts.invalid[Kind.IMU])) != self._usable:
            self._usable, self._usable_came = usable, now
        if self.received[IMU_TOPIC]:
            silence = now - self._usable_came
            useless = "" if now - self._imu_came > SILENT else " but samples of no usable numbers"
            words = f"no IMU{useless} for {silence:.0f} s on {topic}, and no state without it"
            return words if silence > SILENT else ""
        words = f"no IMU has come on {topic}"
        if self.count_publishers(topic):
            return words
        return f"{words}, which nobody publishes: check its name and the remaps"

    def _push(self) -> None:
        waiting, self._waiting = concatenate(self._waiting), []
        if len(waiting):
            own = waiting[~np.isin(waiting.kind, BESIDE)]
            if self.on_samples is not None and len(own):
                self.on_samples(own)
            known = self.check.findings
            self._publish(self.estimator.push(waiting))
            if self.check.findings != known:
                for words in self.check.words:
                    self.get_logger().warning(words)

    def _publish(self, rows: Any) -> None:
        if not len(rows):
            return
        if not self._has_told:
            self._has_told = True
            self.get_logger().info("the first state is there")
        self.rows_published += len(rows)
        if self.on_rows is not None:
            self.on_rows(rows)
        stamps = nanoseconds(rows[:, StateField.TIME], self.estimator.epoch)
        fields = state_fields(rows)
        said = rows[:, [StateField.STATUS, StateField.CONTRADICTION]].astype(int)
        map_ned = self.frame(MAP_NED)
        for i, stamp in enumerate(stamps):
            content = {name: _plain(values[i]) for name, values in fields.items()}
            message = common.fill(AircraftState(), content)
            message.status_text = status_text(*said[i].tolist())
            self._state_publisher.publish(common.stamp_of(message, int(stamp), map_ned))
        self._publish_newest(rows[-1:], int(stamps[-1]))
        if self.on_states is not None:
            self.on_states(rows, stamps)

    def _publish_newest(self, rows: Any, stamp: int) -> None:
        """Wind, where it is estimated, and odometry of the newest row (1, StateField.WIDTH)."""
        if knows_wind(rows)[0]:
            fields, wind = wind_fields(rows), TwistWithCovarianceStamped()
            for part in ("linear", "angular"):
                _set(getattr(wind.twist.twist, part), fields[f"twist.twist.{part}"][0])
            wind.twist.covariance = fields["twist.covariance"][0]
            self._wind_publisher.publish(common.stamp_of(wind, stamp, self.frame(MAP)))
        if not np.isfinite(rows[0, StateField.POSITION.start : StateField.VELOCITY.stop]).all():
            return
        has_place = bool(np.isfinite(rows[0, StateField.ORIGIN]).all())
        self._had_place |= has_place
        if self._had_place and not has_place:  # counted from anew, and no place in a map that began elsewhere
            return
        content, odometry = odometry_content(rows[0]), Odometry(child_frame_id=self.frame(BASE))
        _set(odometry.pose.pose.position, content["position"])
        _set(odometry.pose.pose.orientation, content["orientation"])
        _set(odometry.twist.twist.linear, content["linear"])
        _set(odometry.twist.twist.angular, content["angular"])
        odometry.pose.covariance, odometry.twist.covariance = content["pose_covariance"], content["twist_covariance"]
        self._odometry_publisher.publish(common.stamp_of(odometry, stamp, self.frame(MAP)))
        if self._transforms is not None:
            self._transforms.publish(_transform(odometry, common.message_class(TRANSFORMS)))

    def _on_reset(self, _request: Reset.Request, response: Reset.Response) -> Reset.Response:
        self._survive(self._push)
        self.begin_anew()
        response.success, response.message = True, "the state starts over"
        self.note_call("reset", response.message)
        return response


def _transform(odometry: Odometry, kind: Any) -> Any:
    """The pose of an Odometry as a message of /tf."""
    sent = TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
    place = odometry.pose.pose.position
    _set(sent.transform.translation, (place.x, place.y, place.z))
    sent.transform.rotation = odometry.pose.pose.orientation
    return kind(transforms=[sent])


def _set(vector: Any, values: Any) -> None:
    """Components of a vector or quaternion of geometry_msgs."""
    for name, value in zip("xyzw", values, strict=False):
        setattr(vector, name, float(value))


def _plain(value: Any) -> Any:
    """Python numbers for scalar fields; arrays stay."""
    return value if isinstance(value, np.ndarray) else value.item()


def main() -> None:
    """Executable ``state_estimator``."""
    sys.exit(common.run_node(StateEstimatorNode))


if __name__ == "__main__":
    main()
