"""What presses on pads of a MuJoCo model: its contacts, as newtons on pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.sensor.array import ArrayLayout
from palpate.twin.placement import PixelGrid

_MM_PER_M = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Pad:
    """Where the sheet of one finger lies on a geom; vectors are in the geom's own frame.

    Attributes
    ----------
    geom : str
        Name of the geom that carries the sheet.
    along, across : tuple of float
        The way in which the rows of pixels follow each other, and that of the columns.
    centre_mm : tuple of float
        Middle of the pixels.
    """

    geom: str
    along: tuple[float, float, float] = (0.0, 0.0, 1.0)
    across: tuple[float, float, float] = (0.0, 1.0, 0.0)
    centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


class PadLoads:
    """Contacts on the pads of a model, shared out to pixels.

    The cover of the sheet spreads the force of a contact over a patch, a paraboloid; what arrives
    beyond the outermost pixels counts for the nearest. So the pixels of a pad together carry what
    MuJoCo's contacts press on it.

    Parameters
    ----------
    model : MjModel
        Any model that has the pads' geoms.
    pads : sequence of Pad
        One for each finger of the layout, in its order.
    layout : ArrayLayout
        The pixels.

    Raises
    ------
    InputError
        If the model has no such geom, or the pads don't fit the layout.
    """

    def __init__(self, model: mujoco.MjModel, *, pads: Sequence[Pad], layout: ArrayLayout) -> None:
        if len(pads) != layout.fingers:
            raise InputError(
                f"layout {layout.name} has {layout.fingers} finger(s) and {len(pads)} pad(s) are "
                "given; give one for each finger"
            )
        grid = PixelGrid.of(layout)
        self._model = model
        self._geom = np.array([_geom_id(model, pad.geom) for pad in pads])
        self._pad_of_geom = np.full(model.ngeom, -1)
        self._pad_of_geom[self._geom] = np.arange(len(pads))
        #: Columns are a pad's normal, along and across, in the frame of its geom.
        self._turn = np.array([_axes(pad).T for pad in pads])
        centre_mm = np.array([pad.centre_mm for pad in pads])
        self._middle_mm = (centre_mm[:, None] @ self._turn)[:, 0, 1:]
        self._along_mm, self._across_mm = grid.along_mm, grid.across_mm
        self._edge_mm = np.array([np.ptp(grid.along_mm), np.ptp(grid.across_mm)]) / 2
        self._edge_mm += layout.pitch_mm / 2
        self._on_pad = 1.0 * (grid.finger == np.arange(len(pads))[:, None])

    def load_n(self, data: mujoco.MjData, *, reach_mm: float) -> FloatArray:
        """Return the load of every pixel, shape (pixels,).

        `reach_mm` is how far a contact's force spreads, at least 0.71 of the pitch.
        """
        pad, force_n, place_mm = self.contacts(data)
        if not pad.size:
            return np.zeros(self._along_mm.size)
        place_mm = np.minimum(np.maximum(place_mm, -self._edge_mm), self._edge_mm) / reach_mm
        along = place_mm[:, :1] - self._along_mm / reach_mm
        across = place_mm[:, 1:] - self._across_mm / reach_mm
        weight = np.maximum(1.0 - along * along - across * across, 0.0) * self._on_pad[pad]
        load_n: FloatArray = (force_n / weight.sum(axis=1)) @ weight
        return load_n

    def contacts(self, data: mujoco.MjData) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Return the contacts on the pads.

        Returns
        -------
        pad : ndarray of int, shape (contacts,)
            Which pad.
        force_n : ndarray, shape (contacts,)
            What presses on it, along its normal.
        place_mm : ndarray, shape (contacts, 2)
            Where, along and across, from the middle of its pixels.
        """
        contact = data.contact
        pad = np.maximum(*self._pad_of_geom[contact.geom].T)
        which = (pad >= 0).nonzero()[0]
        if not which.size:
            return which, np.zeros(0), np.zeros((0, 2))
        pad = pad[which]
        # Place and force of each contact as rows, in the world and then in the frame of its pad.
        rows = np.empty((which.size, 2, 3))
        rows[:, 0] = _MM_PER_M * (contact.pos[which] - data.geom_xpos[self._geom[pad]])
        force = np.empty((which.size, 6))
        for row, index in enumerate(which.tolist()):
            mujoco.mj_contactForce(self._model, data, index, force[row])
        rows[:, 1] = (force[:, None, :3] @ contact.frame[which].reshape(-1, 3, 3))[:, 0]
        turn = data.geom_xmat[self._geom].reshape(-1, 3, 3) @ self._turn
        seen = rows @ turn[pad]
        return pad, np.abs(seen[:, 1, 0]), seen[:, 0, 1:] - self._middle_mm[pad]


def _geom_id(model: mujoco.MjModel, name: str) -> int:
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if geom < 0:
        known = [model.geom(index).name for index in range(model.ngeom)]
        raise InputError(
            f"the model has no geom {name!r}; there are: {', '.join(filter(None, known))}"
        )
    return int(geom)


def _axes(pad: Pad) -> FloatArray:
    """Return a pad's normal, along and across as unit rows."""
    along, across = np.array(pad.along), np.array(pad.across)
    rows = np.stack([np.cross(across, along), along, across])
    unit: FloatArray = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return unit
