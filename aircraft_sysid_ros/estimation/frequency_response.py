"""Frequency responses of one output to several inputs at once, with coherence and standard error.

    S_xx(f) G(f) = S_xy(f),    S_ab(f) = mean over windows of conj(A(f)) B(f)

The inputs of an aeroplane that a pilot or a controller flies are correlated: each response is that with the others
held, and its coherence is the partial one, gamma^2 = |S_iy.r|^2 / (S_ii.r S_yy.r), of what the other inputs leave (.r).
Windows are of Hann, without trend, and overlap by half. The standard error of a response over its magnitude, which is
that of its phase [rad] too, is

    sqrt(1 - gamma^2) / (|gamma| sqrt(2 (n / 1.1 - k)))

with n windows, of which half an overlap leaves n / 1.1, and k inputs. M. B. Tischler and R. K. Remple, Aircraft and
Rotorcraft System Identification, chapters 7 and 9; J. S. Bendat and A. G. Piersol, Random Data, chapters 7 and 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

#: So many windows that overlap by half say as much as one that stands apart from the others.
OVERLAP = 1.1
#: Windows of each input that there must be at least: with as many as inputs any coherence is 1.
LEAST_WINDOWS = 3
#: Share of the largest power of an input below which it is not moved at a frequency.
_NOT_MOVED = 1e-6


@dataclass(frozen=True)
class FrequencyResponse:
    """m frequencies, k inputs. NaN where an input does not move."""

    frequency: Array  # (m,) [Hz]
    response: Complex  # (m, k) output over input
    coherence: Array  # (m, k) partial, 0 to 1
    std: Array  # (m, k) of the response, over its magnitude
    windows: int


def frequency_response(
    inputs: Sequence[Array], output: Sequence[Array], step: float, length: float
) -> FrequencyResponse | None:
    """Responses of pieces of a record: inputs (n, k) and outputs (n,) of each at one ``step`` [s].

    ``length`` [s] of the windows: the lowest frequency has two periods in it. None where there are too few windows.
    """
    size = round(length / step)
    spectra = [found for x, y in zip(inputs, output, strict=True) for found in _windows(np.column_stack([x, y]), size)]
    width = inputs[0].shape[1] if len(inputs) else 0
    if len(spectra) < LEAST_WINDOWS * max(width, 1):
        return None
    whole = np.array(spectra)  # (n, m, k + 1)
    power = np.einsum("nfa,nfb->fab", whole.conj(), whole) / len(whole)
    frequency = np.asarray(np.fft.rfftfreq(size, step), np.float64)
    inside = slice(2, None)  # what a window holds less than two periods of leaks from the trend
    found = [_solved(each, width) for each in power[inside]]
    response, coherence = (np.array(each) for each in zip(*found, strict=True))
    moved = power[inside, range(width), range(width)].real
    still = ~(moved > _NOT_MOVED * moved.max(axis=0))
    response[still], coherence[still] = np.nan, np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        std = np.sqrt((1.0 - coherence) / (coherence * 2.0 * (len(whole) / OVERLAP - width)))
    return FrequencyResponse(np.asarray(frequency[inside], np.float64), response, coherence, std, len(whole))


def _windows(record: Array, size: int) -> list[Complex]:
    """Spectra (m, k + 1) of windows of ``size`` samples that overlap by half, where all of them are known."""
    shape = 0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, size + 1)[:-1, None])  # of Hann, periodic
    cut = (record[at : at + size] for at in range(0, len(record) - size + 1, size // 2))
    return [np.fft.rfft(_without_trend(each) * shape, axis=0) for each in cut if np.isfinite(each).all()]


def _without_trend(values: Array) -> Array:
    """Values (n, k) without the straight line of each column."""
    line = np.column_stack([np.arange(1, len(values) + 1) / len(values), np.ones(len(values))])
    return np.asarray(values - line @ np.linalg.lstsq(line, values, rcond=None)[0], np.float64)


def _solved(power: Complex, width: int) -> tuple[Complex, Array]:
    """Responses (k,) and partial coherences (k,) at one frequency, of powers (k + 1, k + 1), the output last."""
    response = np.asarray(np.linalg.lstsq(power[:width, :width], power[:width, width], rcond=None)[0], np.complex128)
    coherence = np.zeros(width)
    for i in range(width):
        others = [j for j in range(width) if j != i]
        left = _without(power, [i, width], others)
        scale = left[0, 0].real * left[1, 1].real
        coherence[i] = min(abs(left[0, 1]) ** 2 / scale, 1.0) if scale > 0.0 else np.nan
    return np.asarray(response, np.complex128), coherence


def _without(power: Complex, kept: list[int], others: list[int]) -> Complex:
    """Powers of ``kept`` of what a linear response to ``others`` leaves of them."""
    block = power[np.ix_(kept, kept)]
    if not others:
        return block
    across = power[np.ix_(others, kept)]
    explained = across.conj().T @ np.linalg.lstsq(power[np.ix_(others, others)], across, rcond=None)[0]
    return np.asarray(block - explained)
