"""What was lost is counted by numbers, and what has come can be received without an executor."""

import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from aircraft_sysid_ros.nodes.inputs import Input, Numbers, drain, lost_in_words


def missing(numbers, publishers=lambda: frozenset([b"a"])):
    counted = Numbers(publishers)
    for number in numbers:
        counted.take(number)
    return counted.missing


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ([1, 2, 3], 0),
        ([17, 18], 0),  # it was sent before anyone listened
        ([1, 2, 5, 6, 9], 4),
        ([None, None], 0),  # a middleware that does not number
        ([], 0),
    ],
)
def test_numbers_that_are_left_out_are_missing(numbers, expected):
    assert missing(numbers) == expected


def test_publishers_are_told_apart_though_their_numbers_mix():
    both = frozenset([b"a", b"b"])
    assert missing([500, 3, 501, 4, 502, 5], lambda: both) == 0
    assert missing([500, 3, 501, 4, 504, 5, 9], lambda: both) == 2 + 3


@pytest.mark.parametrize(("first", "second"), [(500, 3), (1, 1), (4, 3)])
def test_publishers_that_send_by_turns_are_told_from_one_that_follows_another(first, second):
    both = frozenset([b"a", b"b"])
    counted = Numbers(lambda: both)
    for step in range(10):
        counted.take(first + step)
        counted.take(second + step)
    assert counted.turns >= 9 and counted.missing == 0
    turns = counted.turns
    for number in range(first + 10, first + 600):  # the other was killed, and is in the graph
        counted.take(number)
    assert counted.turns <= turns + 1


def test_another_publisher_begins_its_own_count():
    there = [frozenset([b"a"])]
    counted = Numbers(lambda: there[0])
    for number in (1, 2, 3):
        counted.take(number)
    there[0] = frozenset([b"b"])
    for number in (800, 801, 803):  # it has been sending to others
        counted.take(number)
    assert counted.missing == 1
    there[0] = frozenset([b"c"])
    counted.take(1)
    assert counted.missing == 1


def test_words_for_what_was_lost():
    assert lost_in_words({}) == ""
    assert lost_in_words({"imu/data": 3, "gps/fix": 1}) == (
        "messages were lost on the way: 1 of gps/fix, 3 of imu/data (run fewer programs beside it, raise input_depth, "
        "or set input_reliability to reliable)"
    )


@pytest.fixture
def pair(bench):
    """Two inputs on nodes of the bench, their publishers, and what they received, in order."""

    def make(quality, **publisher_quality):
        taken, inputs, publishers = [], [], []
        for topic in ("left", "right"):
            receive = lambda message, topic=topic: taken.append((topic, message.header.stamp.sec))  # noqa: E731
            inputs.append(Input(bench.helper, Imu, topic, receive, quality))
            publisher = bench.helper.create_publisher(Imu, topic, QoSProfile(**(publisher_quality or {"depth": 1000})))
            bench.spin_until(lambda publisher=publisher: publisher.get_subscription_count() > 0)
            publishers.append(publisher)
        return taken, inputs, publishers

    return make


def send(publishers, count):
    message = Imu()
    order = []
    for i in range(count):
        message.header.stamp.sec = i
        side = (i // 3) % 2
        publishers[side].publish(message)
        order.append((("left", "right")[side], i))
    for publisher in publishers:
        publisher.wait_for_all_acked()
    return order


def test_a_drain_receives_what_has_come_in_the_order_in_which_it_was_sent(pair):
    taken, inputs, publishers = pair(QoSProfile(history=HistoryPolicy.KEEP_ALL))
    order = send(publishers, 300)
    left = []
    drain(inputs, left.append)
    assert taken == order
    assert left == list(range(300, 0, -1))
    assert [each.lost for each in inputs] == [0, 0]
    drain(inputs)
    assert taken == order


def test_what_comes_while_a_process_catches_up_keeps_its_order_too(pair, bench):
    """The first fix of a GPS was received seconds before the IMU that had come before it, and was left out as wrong."""
    taken, inputs, publishers = pair(QoSProfile(history=HistoryPolicy.KEEP_ALL))
    for each in inputs:
        each._beside = lambda: inputs
    message, order = Imu(), []

    def publish(number, side):
        message.header.stamp.sec = number
        publishers[side].publish(message)
        publishers[side].wait_for_all_acked()
        order.append((("left", "right")[side], number))

    def busy(received, take=inputs[0]._receive):
        take(received)
        if received.header.stamp.sec == 10:
            for number in range(300, 600):
                publish(number, 0)
            publish(600, 1)
            publish(601, 0)
            time.sleep(0.03)  # longer than what it may be behind

    inputs[0]._receive = busy
    for number in range(300):
        publish(number, 0)
    time.sleep(0.05)
    bench.spin_until(lambda: len(taken) == len(order) == 602)
    assert taken == order


def test_a_process_that_is_behind_receives_all_topics_in_the_order_in_which_they_came(pair, bench):
    """One message of a topic that had been silent was received before hundreds that came before it."""
    taken, inputs, publishers = pair(QoSProfile(history=HistoryPolicy.KEEP_ALL))
    for each in inputs:
        each._beside = lambda: inputs
    message, order = Imu(), []
    for number in range(700):
        message.header.stamp.sec, side = number, int(number in (450, 451, 699))
        publishers[side].publish(message)
        order.append((("left", "right")[side], number))
    for publisher in publishers:
        publisher.wait_for_all_acked()
    time.sleep(0.05)  # what has waited for longer than this is what a process is behind of
    bench.spin_until(lambda: len(taken) == len(order))
    assert taken == order


def test_the_ordinary_executor_gives_message_and_information_too(bench):
    """Where rclpy has no events executor; that one gives both as one argument."""
    taken = []
    node, executor = rclpy.create_node("ordinary"), SingleThreadedExecutor()
    executor.add_node(node)
    quality = QoSProfile(depth=10)
    heard = Input(node, Imu, "ordinary", lambda message: taken.append(message.header.stamp.sec), quality)
    publisher = node.create_publisher(Imu, "ordinary", QoSProfile(depth=100))
    while publisher.get_subscription_count() == 0:
        executor.spin_once(timeout_sec=0.1)
    message = Imu()
    for number in range(40):
        message.header.stamp.sec = number
        publisher.publish(message)
        if number == 0:
            while not taken:
                executor.spin_once(timeout_sec=0.1)
    while len(taken) < 11:
        executor.spin_once(timeout_sec=0.1)
    assert taken == [0, *range(30, 40)] and heard.lost == 29
    executor.shutdown()
    node.destroy_node()


@pytest.mark.parametrize("way", ["drain", "executor"])
def test_an_input_knows_what_its_queue_did_not_hold(bench, pair, way):
    quality = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    taken, inputs, publishers = pair(quality)
    send(publishers, 6)  # both have begun
    bench.spin_until(lambda: len(taken) == 6)
    order = send(publishers, 300)
    if way == "drain":
        drain(inputs)
    bench.spin_until(lambda: order[-1] in taken and order[-4] in taken)
    assert len(taken) == 6 + 2 * 10
    assert [each.lost for each in inputs] == [140, 140]


def test_where_a_fast_topic_lost_its_oldest_a_slow_one_is_not_late(bench):
    """Taken in turn, the fast one ran ahead by all that had been dropped, and every GPS fix was late."""
    taken, inputs = [], []
    quality = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
    for topic in ("fast", "slow"):
        receive = lambda message, topic=topic: taken.append((message.header.stamp.sec, topic))  # noqa: E731
        inputs.append(Input(bench.helper, Imu, topic, receive, quality, lambda: inputs))
    publishers = [bench.helper.create_publisher(Imu, topic, QoSProfile(depth=1000)) for topic in ("fast", "slow")]
    bench.spin_until(lambda: all(publisher.get_subscription_count() for publisher in publishers))
    message = Imu()
    for number in range(200):  # nobody takes them meanwhile
        message.header.stamp.sec = number
        publishers[0].publish(message)
        if number % 20 == 10:
            publishers[1].publish(message)
        time.sleep(0.002)  # they come one by one
    bench.spin_until(lambda: (199, "fast") in taken)
    assert [number for number, topic in taken if topic == "slow"] == list(range(10, 200, 20))
    assert 50 <= len(taken) - 10 < 200
    assert taken == sorted(taken)


def test_what_was_looked_at_is_received_though_nothing_comes_after_it(bench):
    """A message taken to see how old it is waited for the next event, which at the end of a flight never comes."""
    taken, inputs = [], []
    for topic in ("first", "second"):
        quality = QoSProfile(history=HistoryPolicy.KEEP_ALL)
        inputs.append(
            Input(bench.helper, Imu, topic, lambda _, topic=topic: taken.append(topic), quality, lambda: inputs)
        )
    publishers = [bench.helper.create_publisher(Imu, topic, QoSProfile(depth=1000)) for topic in ("first", "second")]
    bench.spin_until(lambda: all(publisher.get_subscription_count() for publisher in publishers))
    for publisher in publishers:
        publisher.publish(Imu())
        time.sleep(0.05)  # nobody takes it: the process is behind
    bench.spin_until(lambda: len(taken) == 2, 10.0)
    assert taken == ["first", "second"]


def test_a_message_that_the_executor_had_in_hand_when_its_node_was_deactivated_is_none(bench):
    """It asked the destroyed subscription for its publishers, and `live` ended with all nodes."""
    taken = []
    heard = Input(bench.helper, Imu, "deactivated", taken.append, QoSProfile(depth=10))
    information = {"received_timestamp": time.time_ns(), "source_timestamp": 0, "publication_sequence_number": 7}
    heard._come(Imu(), information)
    assert len(taken) == 1
    heard.close()
    heard._come(Imu(), {**information, "publication_sequence_number": 9})
    assert len(taken) == 1 and heard.lost == 0
