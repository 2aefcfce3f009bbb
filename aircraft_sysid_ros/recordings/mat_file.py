"""MATLAB 5 files, read in a process of its own.

Of a file with a wrong bit scipy may ask for memory without end, or end its process with a segmentation fault: then
that process ends, and this one says so.
"""

from __future__ import annotations

import faulthandler
import resource
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.archives import allowed_size
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.processes import worker_pool

_PAGE = resource.getpagesize()


class Matlab73(InputError):
    """The file is of MATLAB 7.3, which is HDF5."""


def read_mat(path: Path) -> dict[str, Any]:
    """Variables by name, structures as objects. Raises InputError, one sentence, for whatever it is not."""
    import scipy.io  # noqa: F401  (once here, and not in every process)

    try:
        with worker_pool(1) as pool:
            return dict(pool.submit(_load, path, path.stat().st_size).result())
    except NotImplementedError:
        raise Matlab73(f"{path} is a MATLAB 7.3 file") from None
    except BrokenProcessPool:
        raise InputError(f"{path} is damaged: scipy, which reads .mat files, crashed on it; export it again") from None
    except MemoryError:
        raise InputError(f"{path} is not a readable .mat file: it announces more than its size can hold") from None
    except Exception as error:  # scipy lets errors of zlib, struct and its own through
        raise InputError(f"{path} is not a readable .mat file ({echo(str(error), 200)})") from None


def _load(path: Path, size: int) -> dict[str, Any]:
    from scipy.io import loadmat

    used = int(Path("/proc/self/statm").read_text().split()[0]) * _PAGE
    faulthandler.disable()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (used + 2 * allowed_size(size),) * 2)
    return dict(loadmat(path, squeeze_me=True, struct_as_record=False))
