"""The rig whose frames come from the real firmware: the rigid twin behind simulated chips."""

from __future__ import annotations

from palpate.rig import Rig
from palpate.rig.simulated import open_rigid
from palpate.sensor.array import PressureArray
from palpate.twin.firmware_stream import open_firmware_array
from palpate.twin.ranges import ranges_of
from palpate.twin.world import World


def open_firmware(*, object_name: str | None, seed: int) -> Rig:
    """Open rigid fingers on the twin, read by the firmware on the AVR simulator.

    Raises
    ------
    InputError
        If there is no such object.
    DeviceNotFoundError
        If firmware or simulator have not been built.
    """
    return open_rigid(
        object_name=object_name,
        seed=seed,
        name="sim-firmware",
        origin="firmware-simulated",
        read_through=_read_through_firmware,
    )


def _read_through_firmware(world: World) -> PressureArray:
    divider = world.layout.divider
    count_mv = 1e3 * divider.supply_v / divider.full_scale
    return open_firmware_array(
        world,
        noise_mv=count_mv * ranges_of(world.level).adc_noise_counts,
        rate_hz=world.frame_rate_hz,
    )
