"""A simulated object in MuJoCo: two halves with the twin's force law between them.

The halves overlap; the left pad touches only the left half, the right pad only the right half. The
joint between the halves is the deformation of the object. The object slides on its support along
the closing axis with friction; it can neither turn nor fall.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import mujoco

from palpate.twin.friction import N_PER_G
from palpate.twin.mechanics import RelaxingForce, object_force_n
from palpate.twin.objects import TwinObject
from palpate.twin.plant import TABLE_FRICTION

_MM_PER_M = 1e3
#: Smallest deformation for the slope of the law, because Hertz contact starts with slope 0.
_LEAST_DEPTH_MM = 0.03
#: Phase of the fastest oscillation per time step, radians; the inertia of the halves ensures it.
_PHASE = 0.6
#: Force at which the fastest oscillation is computed, newtons.
_STIFFEST_N = 60.0
#: Damping between the halves (0.04 N at 20 mm/s), and of the object on its support.
_FLATTENING_N_S_PER_M, _SLIDING_N_S_PER_M = 2.0, 0.5
#: Half side of the faces of a flat object, metres: larger than the pads.
_FACE_M = 0.02
#: MuJoCo's contacts are compliant, more so for light objects, which a block calibration cannot
#: correct. These are the hardest contacts that are stable at steps of 1 ms: 0.005 to 0.03 mm/N
#: instead of 0.02 to 0.11 by default.
_CONTACT_IMPEDANCE = [0.97, 0.97, 0.001, 0.5, 2.0]
_PUSH, _SPRING, _FLATTENED = "object_push", "object_spring", "object_flattened"


def add_object(
    spec: mujoco.MjSpec,
    obj: TwinObject,
    *,
    place_mm: tuple[float, float, float],
    pads: tuple[str, str],
) -> None:
    """Add an object to a model with two pads facing each other along x."""
    body = spec.worldbody.add_body(name="object", pos=[mm / _MM_PER_M for mm in place_mm])
    body.add_joint(
        name="object",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[1, 0, 0],
        frictionloss=TABLE_FRICTION * N_PER_G * obj.mass_g,
        damping=_SLIDING_N_S_PER_M,
    )
    other = body.add_body(name="object_half")
    other.add_joint(
        name=_FLATTENED,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[-1, 0, 0],
        limited=True,
        range=[0.0, 0.5 * obj.size_mm / _MM_PER_M],
        damping=_FLATTENING_N_S_PER_M,
        armature=_stiffest_n_per_m(obj) * (spec.option.timestep / _PHASE) ** 2,
    )
    _add_half(spec, body, obj, pad=pads[0], side=-1)
    _add_half(spec, other, obj, pad=pads[1], side=1)
    _add_law(spec)


def _add_half(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, obj: TwinObject, *, pad: str, side: int
) -> None:
    """Add the geom of one half, which collides only with its own pad."""
    half_m, name = 0.5 * obj.size_mm / _MM_PER_M, f"object_{pad}"
    geom = body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[half_m, 0, 0],
        mass=0.5e-3 * obj.mass_g,
        contype=0,
        conaffinity=0,
        rgba=[0.8, 0.3, 0.2, 0.6],
    )
    if obj.flat:
        geom.type = mujoco.mjtGeom.mjGEOM_BOX
        geom.size, geom.pos = [0.5 * half_m, _FACE_M, _FACE_M], [0.5 * side * half_m, 0, 0]
    spec.add_pair(
        name=name,
        geomname1=pad,
        geomname2=name,
        condim=1,
        solref=[0.004, 1.0],
        solimp=_CONTACT_IMPEDANCE,
    )


def _add_law(spec: mujoco.MjSpec) -> None:
    """Add the force between the halves: a push and a spring, both set by commands.

    The law is then part of the state, not of the model.
    """
    joint = {"trntype": mujoco.mjtTrn.mjTRN_JOINT, "target": _FLATTENED}
    spec.add_actuator(name=_PUSH, **joint).gainprm[0] = 1.0
    spring = spec.add_actuator(name=_SPRING, gaintype=mujoco.mjtGain.mjGAIN_AFFINE, **joint)
    spring.gainprm[:3] = [0.0, 1.0, 0.0]


def _stiffest_n_per_m(obj: TwinObject) -> float:
    """Return the slope of an object's law near the largest force."""
    elastic, deep_mm = replace(obj, yield_n=float("inf")), 0.01
    while object_force_n(elastic, deep_mm, ruptured=False)[0] < _STIFFEST_N:
        deep_mm *= 1.1
    return _MM_PER_M * object_force_n(elastic, deep_mm, ruptured=False)[1]


class ObjectDynamics:
    """Apply the force law of an object during a simulation.

    Parameters
    ----------
    obj : TwinObject
        The object.
    model, data : MjModel, MjData
        Model and state with the object of `add_object`.
    """

    def __init__(self, obj: TwinObject, *, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.obj, self._data = obj, data
        self._flattened = int(model.joint(_FLATTENED).qposadr[0])
        self._push, self._spring = model.actuator(_PUSH).id, model.actuator(_SPRING).id
        self._squeeze = RelaxingForce.at_rest(obj)
        self._now_s = data.time
        self.ruptured = False

    def copy(self, data: mujoco.MjData) -> ObjectDynamics:
        """Return an independent object that continues from a copy of the state."""
        other = copy.copy(self)
        other._data = data
        return other

    @property
    def flattening_mm(self) -> float:
        """Deformation of the object."""
        return max(_MM_PER_M * float(self._data.qpos[self._flattened]), 0.0)

    def apply_force(self) -> None:
        """Set the force for the current deformation until the next call."""
        deep_mm = self.flattening_mm
        elastic_n, _ = object_force_n(self.obj, deep_mm, ruptured=self.ruptured)
        self.ruptured = self.ruptured or elastic_n >= self.obj.rupture_n
        step_s, self._now_s = self._data.time - self._now_s, self._data.time
        self._squeeze = self._squeeze.change_to(self.obj, elastic_n=elastic_n, step_s=step_s)
        slope = object_force_n(self.obj, max(deep_mm, _LEAST_DEPTH_MM), ruptured=self.ruptured)[1]
        self._data.ctrl[self._push] = slope * deep_mm - self._squeeze.force_n
        self._data.ctrl[self._spring] = -_MM_PER_M * slope
