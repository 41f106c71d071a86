"""Convert the contacts on the pads of a MuJoCo model to loads of pixels, newtons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import mujoco
import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.sensor.array import ArrayLayout
from palpate.twin.placement import PixelGrid

_MM_PER_M = 1e3

#: A contact on a pad: index of the pad, normal force (N), and position relative to the middle of
#: the pixels, along and across (mm).
Touch: TypeAlias = tuple[int, float, tuple[float, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pad:
    """The sheet of one finger on a geom; vectors are in the geom's frame.

    Attributes
    ----------
    geom : str
        Name of the geom with the sheet.
    along, across : tuple of float
        Directions of increasing row and column number.
    centre_mm : tuple of float
        Middle of the pixels.
    """

    geom: str
    along: tuple[float, float, float] = (0.0, 0.0, 1.0)
    across: tuple[float, float, float] = (0.0, 1.0, 0.0)
    centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchGrid:
    """A `touch_grid` sensor of the model as the pixels of one finger.

    Its bins are the pixels of the finger, with columns along the site's x and rows along the site's
    y. Its first channel, newtons, is the load of the pixels.

    Attributes
    ----------
    sensor : str
        Name of the sensor.
    """

    sensor: str


class GridLoads:
    """Loads of pixels from grids of the model.

    Raises `InputError` if the model has no such sensor, or its bins differ from the pixels.
    """

    def __init__(
        self, model: mujoco.MjModel, *, grids: Sequence[TouchGrid], layout: ArrayLayout
    ) -> None:
        _check_count(grids, layout=layout)
        self._places = []
        for finger, grid in enumerate(grids):
            index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, grid.sensor)
            is_plugin = index >= 0 and model.sensor_type[index] == mujoco.mjtSensor.mjSENS_PLUGIN
            pixels = np.flatnonzero(layout.finger_mask(finger))
            if not is_plugin or model.sensor_dim[index] % len(pixels):
                found = f"has {model.sensor_dim[index]} values" if is_plugin else "does not exist"
                raise InputError(
                    f"the model needs a touch_grid {grid.sensor!r} with the {len(pixels)} pixels "
                    f"of finger {finger} (layout {layout.name}); a touch_grid of this name {found}"
                )
            self._places.append((pixels, int(model.sensor_adr[index])))
        self._pixels = layout.pixels

    def load_n(self, data: mujoco.MjData, *, reach_mm: float) -> FloatArray:
        """Return the load of every pixel, shape (pixels,); `reach_mm` is not used."""
        load_n = np.zeros(self._pixels)
        for pixels, start in self._places:
            # Up to MuJoCo 3.3, pressure on the site is negative.
            load_n[pixels] = np.abs(data.sensordata[start : start + len(pixels)])
        return load_n


def _check_count(pads: Sequence[Pad | TouchGrid], *, layout: ArrayLayout) -> None:
    if len(pads) != layout.fingers:
        raise InputError(
            f"layout {layout.name} has {layout.fingers} finger(s) and {len(pads)} pad(s) are "
            "given; give one for each finger"
        )


class PadLoads:
    """Loads of pixels from the contacts on the pads of a model.

    The cover of the sheet spreads the force of a contact over a patch with a parabolic profile. A
    contact beyond the outermost pixels is assigned to the nearest edge, so the sum over the pixels
    of a pad equals the force of its contacts.

    Parameters
    ----------
    model : MjModel
        Any model with the pads' geoms.
    pads : sequence of Pad
        One pad per finger of the layout, in its order.
    layout : ArrayLayout
        The pixels.

    Raises
    ------
    InputError
        If the model has no such geom, or the pads don't fit the layout.
    """

    def __init__(self, model: mujoco.MjModel, *, pads: Sequence[Pad], layout: ArrayLayout) -> None:
        _check_count(pads, layout=layout)
        grid = PixelGrid.from_layout(layout)
        self._model = model
        self._geom = [_find_geom(model, pad.geom) for pad in pads]
        self._pad_of_geom = [-1] * model.ngeom
        for index, geom in enumerate(self._geom):
            self._pad_of_geom[geom] = index
        #: Columns are a pad's normal, along and across, in the frame of its geom.
        self._rotation = [_unit_axes(pad).T for pad in pads]
        self._middle_mm = [
            (pad.centre_mm @ turn)[1:].tolist()
            for pad, turn in zip(pads, self._rotation, strict=True)
        ]
        #: Along and across, shape (pads, 2, pixels); infinite for pixels of other pads.
        pixel_mm = np.stack([grid.along_mm, grid.across_mm])
        mine = grid.finger == np.arange(len(pads))[:, None, None]
        self._pixel_mm = np.where(mine, pixel_mm, np.inf)
        self._edge_mm = (np.ptp(pixel_mm, axis=1) + layout.pitch_mm) / 2

    def load_n(self, data: mujoco.MjData, *, reach_mm: float) -> FloatArray:
        """Return the load of every pixel, shape (pixels,).

        `reach_mm` is the radius of a contact's spread, at least 0.71 of the pitch.
        """
        touched = self.contacts(data)
        if not touched:
            return np.zeros(self._pixel_mm.shape[2])
        pad, force_n, place_mm = zip(*touched, strict=True)
        within_mm = np.minimum(np.maximum(place_mm, -self._edge_mm), self._edge_mm)
        offset_mm = within_mm[:, :, None] - self._pixel_mm[pad, :]
        offset_mm *= offset_mm
        weight = np.maximum(reach_mm**2 - offset_mm[:, 0] - offset_mm[:, 1], 0.0)
        load_n: FloatArray = (force_n / np.add.reduce(weight, axis=1)) @ weight
        return load_n

    def contacts(self, data: mujoco.MjData) -> list[Touch]:
        """Return the contacts on the pads.

        With few contacts, plain floats are faster than small arrays.
        """
        contact, pad_of = data.contact, self._pad_of_geom
        pads = [max(pad_of[one], pad_of[other]) for one, other in contact.geom.tolist()]
        frames = {pad: self._frame(data, pad) for pad in set(pads) if pad >= 0}
        if not frames:
            return []
        places_m, turns, force = contact.pos.tolist(), contact.frame.tolist(), np.empty(6)
        touched = []
        for index, pad in enumerate(pads):
            if pad < 0:
                continue
            origin_m, (normal, along, across), middle_mm = frames[pad]
            mujoco.mj_contactForce(self._model, data, index, force)
            f, g, h, *_ = force.tolist()
            xx, xy, xz, yx, yy, yz, zx, zy, zz = turns[index]
            push = (f * xx + g * yx + h * zx, f * xy + g * yy + h * zy, f * xz + g * yz + h * zz)
            x, y, z = places_m[index]
            place_m = (x - origin_m[0], y - origin_m[1], z - origin_m[2])
            at_mm = (
                _MM_PER_M * _dot_product(place_m, along) - middle_mm[0],
                _MM_PER_M * _dot_product(place_m, across) - middle_mm[1],
            )
            touched.append((pad, abs(_dot_product(push, normal)), at_mm))
        return touched

    def _frame(self, data: mujoco.MjData, pad: int) -> Any:
        """Return a pad's origin (m), normal, along and across in the world, and middle (mm)."""
        geom = self._geom[pad]
        axes = (data.geom_xmat[geom].reshape(3, 3) @ self._rotation[pad]).T
        return data.geom_xpos[geom].tolist(), axes.tolist(), self._middle_mm[pad]


def _dot_product(one: Sequence[float], other: Sequence[float]) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _find_geom(model: mujoco.MjModel, name: str) -> int:
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if geom < 0:
        known = [model.geom(index).name for index in range(model.ngeom)]
        raise InputError(
            f"the model has no geom {name!r}; available: {', '.join(filter(None, known))}"
        )
    return int(geom)


def _unit_axes(pad: Pad) -> FloatArray:
    """Return a pad's normal, along and across as unit rows."""
    along, across = np.array(pad.along), np.array(pad.across)
    rows = np.stack([np.cross(across, along), along, across])
    unit: FloatArray = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return unit
