"""Records of arrays and numbers that compiled functions share, and change in place.

A record of NumPy is handed on between compiled functions as where it stands. A tuple of arrays is taken apart for that,
array by array and number by number, and references are counted: that was half of the time of an update of the filter.
From Python a compiled function is quickly given an array of one record, and slowly the record alone. Numba takes fields
of numbers, and of arrays but those of truth values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:  # for mypy that of NumPy is final

    class Record:
        """A record whose fields are arrays, named and explained in a class of its own."""

        dtype: np.dtype[np.void]

        def __getitem__(self, name: str) -> npt.NDArray[Any]: ...
        def __setitem__(self, name: str, value: npt.ArrayLike) -> None: ...
else:

    class Record(np.record):
        """As above."""


_R = TypeVar("_R", bound=Record)


def one_record(kind: type[_R], **start: npt.ArrayLike) -> npt.NDArray[np.void]:
    """An array (1,) of a new record with the fields ``start``, in memory of its own."""
    arrays = {name: np.asarray(value) for name, value in start.items()}
    fields = [(name, array.dtype, array.shape) for name, array in arrays.items()]
    records = np.zeros(1, np.dtype((kind, np.dtype(fields, align=True))))
    for name, array in arrays.items():
        records[name][0] = array
    return records


def record(kind: type[_R], **start: npt.ArrayLike) -> _R:
    """The record alone."""
    return cast(_R, one_record(kind, **start)[0])


def in_array(one: Record) -> npt.NDArray[np.void]:
    """An array (1,) of a copy of a record."""
    return np.array([one])


def replaced(one: _R, **changes: npt.ArrayLike) -> _R:
    """A copy of a record with other values in some fields."""
    copy = cast(_R, in_array(one)[0])
    for name, value in changes.items():
        copy[name] = value
    return copy
