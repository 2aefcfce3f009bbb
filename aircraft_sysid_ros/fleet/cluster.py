"""All flights of a fleet on a Dask cluster: one on this machine, or one that is there.

Dask gives every worker one flight at a time, begins a worker anew that was killed, and gives its flight to another
one. What a flight may do to a worker is kept from it by ``apart``.
"""

from __future__ import annotations

import logging
import os
import shutil
import socket
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.apart import Failed, Limits, run_apart
from aircraft_sysid_ros.installation import MissingExtra

#: Flights per thread of the cluster that the scheduler knows at a time: it forgets those that are done.
_AHEAD = 4
#: Where Dask's pages are: for this machine alone, and beside those of other clusters.
_HERE = "127.0.0.1:0"
#: What a worker does first: Ctrl-C is for the one who waits for it, and who ends it.
_DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
#: Time [s] in which a scheduler answers.
_PATIENCE = 10.0
#: Deaths of workers that a flight may see on the cluster of this machine: it never causes them.
_DEATHS = 1_000_000

#: Dask looks after itself many times in a second, which takes 6 % of a core; flights take seconds.
_QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
}


class HasKey(Protocol):
    """A job: it is known by its key."""

    @property
    def key(self) -> str: ...


@dataclass(frozen=True)
class Work:
    """What is done to each job: ``function(job, folder, *more)``, after ``preload`` was imported."""

    function: Callable[..., Mapping[str, Any]]
    more: tuple[Any, ...] = ()
    preload: tuple[str, ...] = ()


def fly_all(
    client: Any,
    jobs: Sequence[HasKey],
    work: Work,
    limits: Limits,
    done: Callable[[HasKey, Mapping[str, Any] | Failed], None],
) -> None:
    """Do all jobs on the cluster of ``client`` and hand each to ``done`` with what came of it, as it comes."""
    from distributed import as_completed

    waiting, running = iter(jobs), as_completed([], loop=client.loop)
    by_key: dict[str, HasKey] = {}

    def submit() -> None:
        job = next(waiting, None)
        if job is not None:
            by_key[job.key] = job
            running.add(client.submit(_fly, job, work, limits, key=job.key, pure=False))

    for _ in range(_AHEAD * max(sum(client.nthreads().values()), 1)):
        submit()
    for future in running:
        submit()
        done(by_key.pop(future.key), _outcome(future))


def _outcome(future: Any) -> Mapping[str, Any] | Failed:
    """What came of a job."""
    from distributed import KilledWorker

    error = future.exception()
    if error is None:
        found: Mapping[str, Any] = future.result()
        return found
    if isinstance(error, Failed):
        return error
    if isinstance(error, KilledWorker):
        return Failed("the workers that it was given to kept ending", lasting=False)
    return Failed(f"its worker failed, {type(error).__name__}: {error}", lasting=False)


def _fly(job: HasKey, work: Work, limits: Limits) -> Mapping[str, Any]:
    """One job on a worker."""
    from distributed import get_worker

    worker = get_worker()
    memory = worker.memory_manager.memory_limit
    share = int(memory / worker.state.nthreads) if memory else None
    try:
        folder = Path(tempfile.mkdtemp(dir=worker.local_directory))
    except OSError as error:
        raise Failed(f"its worker cannot write: {error.strerror or error}", lasting=False) from None
    try:
        function, more = work.function, work.more
        found: Mapping[str, Any] = run_apart(
            function, job, folder, *more, limits=replace(limits, memory=share), preload=work.preload
        )
        return found
    finally:
        shutil.rmtree(folder, ignore_errors=True)


# -- clusters ------------------------------------------------------------------------------------------------


@contextmanager
def cluster(scheduler: str | None, workers: int | None = None) -> Iterator[Any]:
    """The client of a cluster that is there, or of one on this machine. Raises InputError."""
    try:
        import dask
        import distributed
    except ImportError:
        raise MissingExtra("fleets", "dask.distributed", "fleet") from None
    settings = {
        "distributed.worker.daemon": False,
        "distributed.scheduler.allowed-failures": _DEATHS,
        **_QUIET,
        "logging": {"distributed": "critical", "bokeh": "critical", "tornado": "critical"},
    }
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        stack.enter_context(warnings.catch_warnings())
        warnings.filterwarnings("ignore", module="distributed")  # that the port of other clusters is taken
        if scheduler is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="aircraft_sysid_fleet."))
            address: Any = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=workers or len(os.sched_getaffinity(0)),
                    threads_per_worker=1,
                    processes=True,
                    local_directory=folder,
                    dashboard_address=_HERE,
                    worker_dashboard_address=_HERE,
                    preload=[_DEAF],
                    silence_logs=logging.CRITICAL,
                )
            )
        else:
            address = scheduler
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        yield stack.enter_context(_client(distributed, address))


def _client(distributed: Any, address: Any) -> Any:
    try:
        if isinstance(address, str):  # asked first: a client whose start fails complains when it is forgotten
            protocol, place = distributed.comm.addressing.parse_address(address)
            distributed.comm.registry.get_backend(protocol)
            with socket.create_connection(distributed.comm.addressing.parse_host_port(place), timeout=_PATIENCE):
                pass
        return distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, OverflowError, ValueError, KeyError, RuntimeError) as error:
        if not isinstance(address, str):
            raise InputError(f"Dask does not start on this machine: {error}") from None
        raise InputError(
            f"no scheduler answers at {address}: start one with `dask scheduler`, and give its address as it prints it"
        ) from None


def has_dashboard() -> bool:
    """Whether Dask can show its pages."""
    return find_spec("bokeh") is not None
