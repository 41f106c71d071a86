"""Correction of the crosstalk in a passive matrix, where pixels share lines.

Selecting row i and column j of a bare resistor matrix reads pixel (i, j) in parallel with every
detour through other pixels. What the detours do depends on the idle lines:

- *floating* (two multiplexers, as in the paper): the reading is the effective resistance between
  the two lines in the whole network, whatever the divider. Equal pixels of a 2x2 matrix read 25 %
  low, of a 16x16 one 88 % low. Solved back by Newton's method.
- *held* at the rail that the reference resistor goes to (ground for a pixel in the upper leg): the
  detours load the divider instead. Solved back in closed form.

Resistance in series with the lines (a multiplexer's 60-100 ohm) adds to every reading alike and
must be subtracted before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: A pixel that carries less than this fraction of its reading's conductance can't be distinguished
#: from open.
_HIDDEN_SHARE = 1e-5
_TOLERANCE = 1e-9
_MAX_STEPS = 60
#: Frames are solved in batches of this many numbers (32 MB) per intermediate array.
_MOST_COUPLINGS = 1 << 22

_Array = NDArray[np.float64]


def floating_readings_ohm(resistance_ohm: ArrayLike) -> _Array:
    """Return the reading of each pixel when all idle lines float.

    `resistance_ohm`, shape (..., rows, cols): pixel resistances, positive; inf is an open pixel.
    Returns effective resistance between the pixel's row and column; inf where no path is.

    Source: Klein and Randic, "Resistance distance", J. Math. Chem. 12 (1993): r = K_aa + K_bb - 2
    K_ab.

    Three equal pixels in series, in parallel with the one that is read:

    >>> floating_readings_ohm([[100.0, 100.0], [100.0, 100.0]]).round(6).tolist()
    [[75.0, 75.0], [75.0, 75.0]]
    """
    resistance = _not_negative(resistance_ohm)
    if not np.all(resistance > 0):
        raise ValueError("pixel resistances must be positive (inf is an open pixel)")
    rows, cols = resistance.shape[-2:]
    frames = resistance.reshape(-1, rows, cols)
    # An open pixel is given a billionth of the smallest conductance: the network stays connected.
    finite = np.where(np.isfinite(frames), frames, 0.0)
    open_ohm = 1e9 * np.maximum(finite.max(axis=(1, 2), keepdims=True), 1.0)
    lines = _line_coupling(1.0 / np.where(np.isfinite(frames), frames, open_ohm))
    readings = np.diagonal(lines, axis1=1, axis2=2).reshape(frames.shape)
    cut_off = readings > open_ohm / (rows * cols)
    return np.where(cut_off, np.inf, readings).reshape(resistance.shape)


def unmix_floating(readings_ohm: ArrayLike) -> _Array:
    """Solve the readings of a matrix with floating idle lines back to pixel resistances.

    With T the voltages across all pixels per ampere through each selected one, the readings are
    diag(T) and d ln(reading) = -P d ln(conductance), P = T^2 g / diag(T), whose rows sum to one.
    Newton's method in the logarithms keeps every conductance positive. Where a reading is higher
    than its detours alone allow (noise on a resistive pixel next to pressed ones), the pixel is
    given up as hidden and the others are solved without it.

    `readings_ohm`, shape (..., rows, cols): readings; inf is an open circuit, 0 a short.
    Returns resistances, batched as the input: inf where the pixel is open or hidden, NaN in a frame
    whose readings no resistances explain. Raises `ValueError` if a reading is negative or NaN.

    >>> unmix_floating([[75.0, 75.0], [75.0, 75.0]]).round(6).tolist()
    [[100.0, 100.0], [100.0, 100.0]]
    """
    readings = _not_negative(readings_ohm)
    rows, cols = readings.shape[-2:]
    flat = readings.reshape(-1, rows * cols)
    resistance = np.empty(flat.shape)
    at_once = max(1, _MOST_COUPLINGS // (rows * cols) ** 2)
    for start in range(0, len(flat), at_once):
        part = slice(start, start + at_once)
        resistance[part] = _solve_floating(flat[part], (rows, cols))
    return resistance.reshape(readings.shape)


def unmix_held(readings_ohm: ArrayLike, *, reference_ohm: float) -> _Array:
    """Solve a matrix with idle rows held at a rail for its pixel resistances.

    With y the pixel's share of the supply across the reference resistor, y = g / (g_ref + column
    sum of g), so that g = g_ref y / (1 - column sum of y).

    `readings_ohm`, shape (..., rows, cols): readings as the divider's formula gives them; inf is an
    open circuit, 0 a short.
    Returns resistances; NaN in a column whose shares reach the whole supply, as with a short.

    >>> unmix_held([[2000.0], [2000.0]], reference_ohm=1000.0).round(6).tolist()
    [[1000.0], [1000.0]]
    """
    readings = _not_negative(readings_ohm)
    share = reference_ohm / (reference_ohm + readings)
    left = 1.0 - share.sum(axis=-2, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(left > 0, reference_ohm * left / share, np.nan)


def _not_negative(ohm: ArrayLike) -> _Array:
    values = np.asarray(ohm, dtype=np.float64)
    if values.ndim < 2:
        raise ValueError(f"expected shape (..., rows, cols), got {values.shape}")
    if not np.all(values >= 0):
        raise ValueError("readings can't be negative or NaN (inf is an open circuit, 0 a short)")
    return values


def _solve_floating(flat: _Array, shape: tuple[int, int]) -> _Array:
    """Return resistances of frames of shape (batch, pixels)."""
    rows, cols = shape
    measured = np.isfinite(flat) & (flat > 0)
    ceiling = 1e6 * np.max(np.where(measured, flat, 0.0), axis=1, keepdims=True, initial=1.0)
    floor = 1e-4 * np.min(np.where(measured, flat, np.inf), axis=1, keepdims=True, initial=1.0)
    log_target = np.log(np.clip(flat, floor, ceiling))
    log_g = np.log((rows + cols - 1) / (rows * cols)) - log_target
    hidden = np.zeros(flat.shape, dtype=bool)
    active = np.arange(len(flat))
    for _ in range(_MAX_STEPS):
        error, sharing = _mismatch(log_g[active], log_target[active], shape=shape)
        hidden[active] |= log_g[active] + log_target[active] < np.log(_HIDDEN_SHARE)
        error[hidden[active]] = 0.0
        sharing = _without(sharing, hidden[active])
        done = np.max(np.abs(error), axis=1) < _TOLERANCE
        active, error, sharing = active[~done], error[~done], sharing[~done]
        if not len(active):
            break
        step = np.linalg.solve(sharing, error[:, :, None])[:, :, 0]
        log_g[active] += np.clip(step, -1.0, 1.0)
    resistance: _Array = np.exp(-log_g)
    resistance[hidden | np.isinf(flat)] = np.inf
    resistance[flat == 0] = 0.0
    resistance[active] = np.nan
    return resistance


def _line_coupling(conductance: _Array) -> _Array:
    """Volts across each pixel per ampere through each selected one, (batch, pixels, pixels)."""
    batch, rows, cols = conductance.shape
    size = rows + cols - 1  # the last column is the node that voltages are counted from
    laplacian = np.zeros((batch, size, size))
    row, col = np.arange(rows), np.arange(cols - 1)
    laplacian[:, row, row] = conductance.sum(axis=2)
    laplacian[:, rows + col, rows + col] = conductance.sum(axis=1)[:, :-1]
    laplacian[:, :rows, rows:] = -conductance[:, :, :-1]
    laplacian[:, rows:, :rows] = -conductance[:, :, :-1].transpose(0, 2, 1)
    inverse = np.zeros((batch, rows + cols, rows + cols))
    inverse[:, :-1, :-1] = np.linalg.inv(laplacian)
    first, second = np.divmod(np.arange(rows * cols), cols)
    across = inverse[:, first, :] - inverse[:, rows + second, :]
    return np.asarray(across[:, :, first] - across[:, :, rows + second])


def _mismatch(
    log_g: _Array, log_target: _Array, *, shape: tuple[int, int]
) -> tuple[_Array, _Array]:
    """ln(modelled / measured reading), and the sharing matrix P."""
    conductance = np.exp(log_g)
    coupling = _line_coupling(conductance.reshape(-1, *shape))
    own = np.diagonal(coupling, axis1=1, axis2=2)
    sharing = coupling**2 * conductance[:, None, :] / own[:, :, None]
    return np.log(own) - log_target, sharing


def _without(sharing: _Array, hidden: NDArray[np.bool_]) -> _Array:
    """Take hidden pixels out of the equations: neither solved for nor listened to."""
    used = ~hidden
    kept = sharing * (used[:, :, None] & used[:, None, :])
    pixel = np.arange(sharing.shape[1])
    kept[:, pixel, pixel] = np.where(hidden, 1.0, kept[:, pixel, pixel])
    return np.asarray(kept)
