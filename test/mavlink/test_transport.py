"""Real sockets and a pseudo-terminal: bytes arrive, broken connections come back, wrong addresses are said."""

import errno
import os
import socket
import time

import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.transport import Transport, parse_address


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def read_until(transport, wanted, timeout=60.0):
    data, ends = b"", time.monotonic() + timeout
    while len(data) < wanted and time.monotonic() < ends:
        data += transport.read(0.05)
    return data


@pytest.mark.parametrize(
    ("text", "kind", "place", "number"),
    [
        ("udp:0.0.0.0:14550", "udpin", "0.0.0.0", 14550), ("udpout:10.0.0.2:14551", "udpout", "10.0.0.2", 14551),
        ("tcp:localhost:5760", "tcp", "localhost", 5760), ("/dev/ttyACM0", "serial", "/dev/ttyACM0", 57600),
        ("/dev/ttyACM0,921600", "serial", "/dev/ttyACM0", 921600),
        ("serial:/dev/ttyS1:115200", "serial", "/dev/ttyS1", 115200),
    ],
)  # fmt: skip
def test_addresses(text, kind, place, number):
    address = parse_address(text)
    assert (address.kind, address.place, address.number) == (kind, place, number)


NONE = ["", "udp", "udp:14550", "http://x:1", "udp::14550", "tcp:host:99999", "udp:host:port"]


@pytest.mark.parametrize("text", NONE)
def test_what_is_no_address(text):
    with pytest.raises(InputError):
        parse_address(text)


def test_udp_answers_whoever_spoke():
    port = free_port()
    ears, mouth = (Transport(parse_address(f"{kind}:127.0.0.1:{port}")) for kind in ("udpin", "udpout"))
    ears.open()
    mouth.open()
    ears.write(b"to nobody")
    mouth.write(b"question")
    assert read_until(ears, 8) == b"question"
    ears.write(b"answer")
    assert read_until(mouth, 6) == b"answer"
    with pytest.raises(InputError, match=r"cannot open udpin:127\.0\.0\.1"):
        Transport(parse_address(f"udp:127.0.0.1:{port}")).open()
    ears.close()
    for _ in range(5):
        mouth.write(b"into the void")  # the system reports a refusal; it is none of ours
        assert mouth.read(0.02) == b""
    ears.open()
    mouth.write(b"again")
    assert read_until(ears, 5).endswith(b"again")
    for transport in (ears, mouth):
        transport.close()


def held():
    """An open port that holds the vehicle which it has heard, the vehicle, and a stranger to the same port."""
    port = free_port()
    ears, vehicle, stranger = (
        Transport(parse_address(f"{kind}:127.0.0.1:{port}")) for kind in ("udp", "udpout", "udpout")
    )
    for transport in (ears, vehicle, stranger):
        transport.open()
    vehicle.write(b"heartbeat")
    assert read_until(ears, 9) == b"heartbeat"
    ears.hold()
    return ears, vehicle, stranger


def test_a_network_that_is_gone_for_a_while_lets_no_stranger_take_the_place_of_the_peer():
    """What cannot be sent closed the port, and with it who is heard was forgotten: whoever spoke first was it then."""
    ears, vehicle, stranger = held()

    class Gone:
        """The socket, that reaches nobody."""

        def __init__(self, device):
            self.device = device

        def sendto(self, data, peer):
            raise OSError(errno.EHOSTUNREACH, "No route to host")

        def __getattr__(self, name):
            return getattr(self.device, name)

    whole, ears._device = ears._device, Gone(ears._device)
    ears.write(b"into the void")
    if ears._device is not None:
        ears._device = whole
    stranger.write(b"stranger")
    vehicle.write(b"vehicle")
    assert read_until(ears, 7) == b"vehicle" and ears.foreign == 1 and ears.openings == 1
    for transport in (ears, vehicle, stranger):
        transport.close()


def test_only_the_peer_is_heard_and_answered_once_it_is_held():
    ears, vehicle, stranger = held()
    stranger.write(b"forged")
    vehicle.write(b"genuine")
    assert read_until(ears, 7) == b"genuine" and ears.foreign == 1
    ears.write(b"for you")
    assert read_until(vehicle, 7) == b"for you" and stranger.read(0.05) == b""
    ears.release()  # it is silent: it may come back from another port
    stranger.write(b"who is there")
    assert read_until(ears, 12) == b"who is there"
    ears.write(b"only you")
    assert read_until(vehicle, 8) == b"only you" and stranger.read(0.05) == b""
    for transport in (ears, vehicle, stranger):
        transport.close()


def test_a_host_that_was_named_is_the_only_one():
    port = free_port()
    ears = Transport(parse_address(f"udp:127.0.0.1:{port}"), "127.0.0.2")
    ears.open()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own,
    ):
        own.bind(("127.0.0.2", 0))
        other.sendto(b"other", ("127.0.0.1", port))
        own.sendto(b"own", ("127.0.0.1", port))
        assert read_until(ears, 3) == b"own" and ears.foreign == 1
    ears.close()
    with pytest.raises(InputError, match="cannot open"):
        Transport(parse_address(f"udp:127.0.0.1:{port}"), "no.such.host.invalid").open()


@pytest.mark.long
def test_tcp_is_connected_again():
    port = free_port(socket.SOCK_STREAM)

    def serve():
        server = socket.create_server(("127.0.0.1", port))
        return server

    server = serve()
    transport = Transport(parse_address(f"tcp:127.0.0.1:{port}"))
    transport.open()
    peer, _ = server.accept()
    peer.sendall(b"one")
    assert read_until(transport, 3) == b"one"
    peer.close()
    server.close()
    assert read_until(transport, 1, 0.8) == b""
    server = serve()
    server.settimeout(8.0)
    deadline = time.monotonic() + 8.0
    while transport.openings < 2 and time.monotonic() < deadline:
        transport.read(0.05)
    peer, _ = server.accept()
    peer.sendall(b"two")
    assert read_until(transport, 3) == b"two"
    peer.close()
    server.close()
    transport.close()
    with pytest.raises(InputError, match="cannot open tcp"):
        Transport(parse_address(f"tcp:127.0.0.1:{port}")).open()


def test_a_serial_port_that_is_pulled_out():
    pytest.importorskip("serial")
    master, slave = os.openpty()
    transport = Transport(parse_address(f"serial:{os.ttyname(slave)}:57600"))
    transport.open()
    os.write(master, b"hello")
    assert read_until(transport, 5) == b"hello"
    transport.write(b"back")
    assert os.read(master, 4) == b"back"
    os.close(master)
    os.close(slave)
    ends = time.monotonic() + 3.0
    while time.monotonic() < ends and transport._device is not None:
        assert transport.read(0.05) == b""
    assert transport._device is None
    transport.close()
    with pytest.raises(InputError, match="cannot open serial"):
        Transport(parse_address("serial:/dev/nowhere:57600")).open()
