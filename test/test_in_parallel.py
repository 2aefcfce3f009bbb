"""Work on all cores: in order, on what cannot be sent, and with the sentence of what is refused."""

import multiprocessing
import os
import select
import signal
import time

import pytest
from waiting import LONGEST

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import CORES, beside, in_parallel


class Unsendable:
    """Work that no process could be sent."""

    def __init__(self, number):
        self.number = number

    def __reduce__(self):
        raise AssertionError("it was sent")


@pytest.mark.parametrize("cores", ["1", "2", "3"])
def test_results_come_in_order_from_work_that_is_not_sent(monkeypatch, cores):
    monkeypatch.setenv(CORES, cores)
    factor = 3
    found = list(in_parallel(lambda item: (factor * item.number, os.getpid()), [Unsendable(n) for n in range(7)]))
    assert [number for number, _ in found] == [0, 3, 6, 9, 12, 15, 18]
    assert (os.getpid() in {process for _, process in found}) == (cores == "1")
    assert list(in_parallel(lambda item: item, [])) == []


def test_one_core_does_only_what_is_asked_for(monkeypatch):
    monkeypatch.setenv(CORES, "1")
    done = []
    assert next(in_parallel(done.append, ["first", "second"])) is None
    assert done == ["first"]


@pytest.mark.parametrize("cores", ["1", "2"])
def test_a_refusal_is_the_callers(monkeypatch, cores):
    monkeypatch.setenv(CORES, cores)

    def refuse(number):
        raise InputError(f"{number} is no good: take another")

    with pytest.raises(InputError, match="4 is no good: take another"):
        list(in_parallel(refuse, [4, 5]))


@pytest.mark.parametrize("ends", ["refused", "interrupted", "left"])
def test_nobody_waits_for_the_others_where_it_ends_before(monkeypatch, capfd, ends):
    monkeypatch.setenv(CORES, "2")
    heard, said = os.pipe()

    def work(number):
        if number == 0:
            os.read(heard, 1)  # the other one is at it
            if ends == "refused":
                raise InputError("no good: take another")
            return number
        os.write(said, b"x")
        time.sleep(LONGEST)

    begun = time.monotonic()
    raised = {"refused": InputError, "interrupted": KeyboardInterrupt, "left": RuntimeError}[ends]
    with pytest.raises(raised):
        for _ in in_parallel(work, [0, 1]):
            raise raised("the other work")
    assert not multiprocessing.active_children() and time.monotonic() - begun < 0.5 * LONGEST
    assert capfd.readouterr().err == ""


def test_one_piece_of_work_goes_on_beside_another(monkeypatch):
    monkeypatch.setenv(CORES, "2")
    (heard, said), work = os.pipe(), Unsendable(3)

    def begin():
        os.write(said, b"begun")
        return 2 * work.number, os.getpid(), os.environ[CORES]

    with beside(begin) as result:
        assert select.select([heard], [], [], LONGEST)[0]  # it has begun, and nobody has asked for it yet
        number, process, cores = result()
    assert (number, cores) == (6, "1") and process != os.getpid()


def test_on_one_core_it_is_done_when_it_is_asked_for(monkeypatch):
    monkeypatch.setenv(CORES, "1")
    done = []
    with beside(lambda: done.append("asked")) as result:
        assert not done
        result()
    assert done == ["asked"]


def test_a_refusal_beside_is_the_callers(monkeypatch):
    monkeypatch.setenv(CORES, "2")

    def refuse():
        raise InputError("no good: take another")

    with beside(refuse) as result, pytest.raises(InputError, match="no good: take another"):
        result()


def test_what_is_ended_beside_is_done_again(monkeypatch):
    """As by a system that has no memory left."""
    monkeypatch.setenv(CORES, "2")
    own = os.getpid()

    def ended():
        if os.getpid() != own:
            os.kill(os.getpid(), signal.SIGKILL)
        return "done here"

    with beside(ended) as result:
        assert result() == "done here"


def test_nothing_goes_on_beside_what_failed(monkeypatch):
    monkeypatch.setenv(CORES, "2")
    heard, said = os.pipe()

    def for_ever():
        os.write(said, str(os.getpid()).encode())
        signal.pause()

    with pytest.raises(RuntimeError, match="the other work"), beside(for_ever):
        process = int(os.read(heard, 20))
        raise RuntimeError("the other work")
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
