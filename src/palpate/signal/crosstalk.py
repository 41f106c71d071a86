"""Correction of the crosstalk in a passive matrix, whose pixels share lines.

In a resistor matrix without diodes, the reading of row i and column j includes pixel (i, j) and all
parallel paths through other pixels. The effect of the parallel paths depends on the idle lines:

- *floating* (two multiplexers, as in the paper): the reading is the effective resistance between
  the two lines in the network, for any divider. Equal pixels read 25 % too low in a 2x2 matrix and
  88 % too low in a 16x16 matrix. The correction uses Newton's method.
- *held* at the rail of the reference resistor (ground for a pixel in the upper leg): the parallel
  paths load the divider. The correction is in closed form.

Series resistance of the lines (60-100 ohm in a multiplexer) adds equally to every reading and must
be subtracted before the correction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray

#: A pixel with less than this fraction of its reading's conductance counts as open (hidden).
_HIDDEN_FRACTION = 1e-5
_TOLERANCE = 1e-9
_MAX_STEPS = 60
#: Batch size: maximum number of elements (32 MB) per intermediate array.
_MAX_COUPLINGS = 1 << 22


def floating_readings_ohm(resistance_ohm: ArrayLike) -> FloatArray:
    """Return the reading of each pixel when all idle lines float.

    `resistance_ohm`, shape (..., rows, cols): pixel resistances, positive; inf is an open pixel.
    Returns the effective resistance between the pixel's row and column; inf without a path.

    Source: Klein and Randic, "Resistance distance", J. Math. Chem. 12 (1993): r = K_aa + K_bb - 2
    K_ab.

    Three equal pixels in series, in parallel with the selected pixel:

    >>> floating_readings_ohm([[100.0, 100.0], [100.0, 100.0]]).round(6).tolist()
    [[75.0, 75.0], [75.0, 75.0]]
    """
    resistance = _as_nonnegative(resistance_ohm)
    if not np.all(resistance > 0):
        raise ValueError("pixel resistances must be positive (inf is an open pixel)")
    rows, cols = resistance.shape[-2:]
    frames = resistance.reshape(-1, rows, cols)
    # An open pixel gets a billionth of the smallest conductance, to keep the network connected.
    finite = np.where(np.isfinite(frames), frames, 0.0)
    open_ohm = 1e9 * np.maximum(finite.max(axis=(1, 2), keepdims=True), 1.0)
    lines = _line_coupling(1.0 / np.where(np.isfinite(frames), frames, open_ohm))
    readings = np.diagonal(lines, axis1=1, axis2=2).reshape(frames.shape)
    is_disconnected = readings > open_ohm / (rows * cols)
    return np.where(is_disconnected, np.inf, readings).reshape(resistance.shape)


def unmix_floating(readings_ohm: ArrayLike) -> FloatArray:
    """Solve for the pixel resistances of a matrix with floating idle lines.

    Let T be the voltages across all pixels per ampere through each selected pixel. The readings are
    diag(T), and d ln(reading) = -P d ln(conductance) with P = T^2 g / diag(T), whose rows sum to
    one. Newton's method in the logarithms keeps all conductances positive. Noise on a pixel with
    high resistance next to pressed pixels can raise its reading above that of the parallel paths
    alone. Such a pixel counts as hidden, and the other pixels are solved without it.

    `readings_ohm`, shape (..., rows, cols): readings; inf is an open circuit, 0 a short.
    Returns resistances with the shape of the input. They are inf for an open or hidden pixel, and
    NaN in a frame that no set of resistances explains.
    Raises `ValueError` if a reading is negative or NaN.

    >>> unmix_floating([[75.0, 75.0], [75.0, 75.0]]).round(6).tolist()
    [[100.0, 100.0], [100.0, 100.0]]
    """
    readings = _as_nonnegative(readings_ohm)
    rows, cols = readings.shape[-2:]
    flat = readings.reshape(-1, rows * cols)
    resistance = np.empty(flat.shape)
    batch_size = max(1, _MAX_COUPLINGS // (rows * cols) ** 2)
    for start in range(0, len(flat), batch_size):
        batch = slice(start, start + batch_size)
        resistance[batch] = _solve_floating(flat[batch], (rows, cols))
    return resistance.reshape(readings.shape)


def unmix_held(readings_ohm: ArrayLike, *, reference_ohm: float) -> FloatArray:
    """Solve for the pixel resistances of a matrix with idle rows held at a rail.

    Let y be the fraction of the supply across the reference resistor. Then
    y = g / (g_ref + column sum of g), and g = g_ref y / (1 - column sum of y).

    `readings_ohm`, shape (..., rows, cols): readings computed with the divider's formula; inf is an
    open circuit, 0 a short.
    Returns resistances; NaN in a column whose fractions sum to one or more, as with a short.

    >>> unmix_held([[2000.0], [2000.0]], reference_ohm=1000.0).round(6).tolist()
    [[1000.0], [1000.0]]
    """
    readings = _as_nonnegative(readings_ohm)
    fraction = reference_ohm / (reference_ohm + readings)
    remainder = 1.0 - fraction.sum(axis=-2, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(remainder > 0, reference_ohm * remainder / fraction, np.nan)


def _as_nonnegative(ohm: ArrayLike) -> FloatArray:
    values = np.asarray(ohm, dtype=np.float64)
    if values.ndim < 2:
        raise ValueError(f"expected shape (..., rows, cols), got {values.shape}")
    if not np.all(values >= 0):
        raise ValueError("readings can't be negative or NaN (inf is an open circuit, 0 a short)")
    return values


def _solve_floating(flat: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Return the pixel resistances for readings of shape (batch, pixels)."""
    rows, cols = shape
    measured = np.isfinite(flat) & (flat > 0)
    ceiling = 1e6 * np.max(np.where(measured, flat, 0.0), axis=1, keepdims=True, initial=1.0)
    floor = 1e-4 * np.min(np.where(measured, flat, np.inf), axis=1, keepdims=True, initial=1.0)
    log_target = np.log(np.clip(flat, floor, ceiling))
    log_g = np.log((rows + cols - 1) / (rows * cols)) - log_target
    hidden = np.zeros(flat.shape, dtype=bool)
    active = np.arange(len(flat))
    for _ in range(_MAX_STEPS):
        error, jacobian = _compute_mismatch(log_g[active], log_target[active], shape=shape)
        hidden[active] |= log_g[active] + log_target[active] < np.log(_HIDDEN_FRACTION)
        error[hidden[active]] = 0.0
        jacobian = _exclude_hidden(jacobian, hidden[active])
        done = np.max(np.abs(error), axis=1) < _TOLERANCE
        active, error, jacobian = active[~done], error[~done], jacobian[~done]
        if not len(active):
            break
        step = np.linalg.solve(jacobian, error[:, :, None])[:, :, 0]
        log_g[active] += np.clip(step, -1.0, 1.0)
    resistance: FloatArray = np.exp(-log_g)
    resistance[hidden | np.isinf(flat)] = np.inf
    resistance[flat == 0] = 0.0
    resistance[active] = np.nan
    return resistance


def _line_coupling(conductance: FloatArray) -> FloatArray:
    """Return volts across each pixel per ampere through each, (batch, pixels, pixels)."""
    batch, rows, cols = conductance.shape
    size = rows + cols - 1  # the last column is the reference node
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


def _compute_mismatch(
    log_g: FloatArray, log_target: FloatArray, *, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return ln(modelled / measured reading), and the matrix P of `unmix_floating`."""
    conductance = np.exp(log_g)
    coupling = _line_coupling(conductance.reshape(-1, *shape))
    own = np.diagonal(coupling, axis1=1, axis2=2)
    jacobian = coupling**2 * conductance[:, None, :] / own[:, :, None]
    return np.log(own) - log_target, jacobian


def _exclude_hidden(jacobian: FloatArray, hidden: NDArray[np.bool_]) -> FloatArray:
    """Remove the unknowns and the equations of hidden pixels."""
    used = ~hidden
    reduced = jacobian * (used[:, :, None] & used[:, None, :])
    pixel = np.arange(jacobian.shape[1])
    reduced[:, pixel, pixel] = np.where(hidden, 1.0, reduced[:, pixel, pixel])
    return np.asarray(reduced)
