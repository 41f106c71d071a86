"""`palpate serve`: the dashboard in a browser."""

from __future__ import annotations

import os
import socket
import ssl
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from palpate.cli import options as option
from palpate.cli.options import opt, parse_address
from palpate.cli.output import print_message
from palpate.errors import DeviceError, InputError
from palpate.object.damage_file import DamageFile
from palpate.rig import BUILT_IN, rig_names
from palpate.twin.objects import OBJECTS
from palpate_station.cli.options import STATION_VARIABLE
from palpate_station.qualify.conversion import Conversion
from palpate_station.records import check_printable

if TYPE_CHECKING:
    # Each requires an extra.
    from palpate_station.dashboard.item_store import ItemStore
    from palpate_station.dashboard.server import LineOpener
    from palpate_station.dashboard.users import User
    from palpate_station.line.machine import Line, Machine
    from palpate_station.line.modbus import ModbusStation
    from palpate_station.line.opcua import OpcUaStation
    from palpate_station.mqtt.publisher import Publisher
    from palpate_station.sorting.rules import RuleBook

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def serve(
    rig: option.RigOption = "",
    object_name: option.ObjectOption = None,
    seed: option.SeedOption = 0,
    rate_hz: option.SimulatedRateOption = None,
    speed: Annotated[
        float, opt("--speed", "Simulated rigs: speed relative to real time.", min=0.1, max=20.0)
    ] = 1.0,
    folder: Annotated[
        Path, opt("--folder DIR", "Folder of recordings and of calibrations of simulated rigs.")
    ] = Path("palpate-data"),
    store: option.StoreOption = None,
    damage: option.DamageOption = None,
    rules: Annotated[
        Path | None,
        opt("--rules FILE", "Show the bin of each grasped item: a rules file of `palpate sort`."),
    ] = None,
    words: Annotated[
        Path | None, opt("--words FILE", "Texts of the operator's page in another language (JSON).")
    ] = None,
    require_item: Annotated[
        bool, opt("--require-item", "Refuse a grasp without the name of its item.")
    ] = False,
    reference: Annotated[
        Path | None,
        opt(
            "--reference FILE",
            "Answer in a buyer's unit too: a file of `palpate qualify --save`.",
        ),
    ] = None,
    exit_after_s: Annotated[
        float | None,
        opt(
            "--exit-after SECONDS",
            "End if the devices have not worked for this time, so that a service manager starts "
            "palpate serve again.",
            min=1.0,
        ),
    ] = None,
    station: Annotated[
        str | None,
        opt(
            "--station NAME",
            "Name of this station in results and records; a GLN is a place in EPCIS.",
            envvar=STATION_VARIABLE,
            show_envvar=True,
        ),
    ] = None,
    keep_days: Annotated[
        float | None,
        opt(
            "--keep-days N",
            "Delete recordings of grasps after N days, unless renamed; items stay in the store.",
            min=0.04,
        ),
    ] = None,
    host: Annotated[
        str,
        opt(
            "--host",
            "Listening address; addresses other than loopback require --token.",
            envvar="PALPATE_HOST",
            show_envvar=True,
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, opt("--port", "TCP port; 0 selects a free port.", min=0, max=65535)
    ] = 8080,
    token: Annotated[
        str | None,
        opt("--token", "Password for visitors.", envvar="PALPATE_TOKEN", show_envvar=True),
    ] = None,
    users: Annotated[
        Path | None,
        opt(
            "--users FILE",
            "Users with tokens and roles: view, operate, configure (docs: Connect a packhouse).",
        ),
    ] = None,
    certificate: Annotated[
        Path | None, opt("--certificate FILE", "Serve HTTPS with this certificate (PEM).")
    ] = None,
    key: Annotated[Path | None, opt("--key FILE", "Private key of --certificate (PEM).")] = None,
    mqtt: Annotated[
        Path | None,
        opt(
            "--mqtt FILE",
            "Publish results and state to the broker described in this file "
            "(docs: Connect a packhouse).",
        ),
    ] = None,
    opcua: Annotated[
        str | None,
        opt(
            "--opcua [HOST:]PORT",
            "Serve OPC UA, encrypted with --token as the password; required beyond loopback.",
        ),
    ] = None,
    modbus: Annotated[
        str | None,
        opt(
            "--modbus [HOST:]PORT",
            "Serve Modbus TCP, which has no password: every client with access can start grasps.",
        ),
    ] = None,
) -> None:
    """Serve the dashboard: pixels, prediction and verdict; grasp, calibrate, replay.

    Example: palpate serve --rig sim-rigid --object avocado-day-3
    """
    from palpate_station.dashboard.item_store import ItemStore
    from palpate_station.dashboard.server import serve as serve_page
    from palpate_station.dashboard.settings import Settings
    from palpate_station.dashboard.users import read_users

    if rig not in rig_names() and not (rig.endswith(".toml") and Path(rig).is_file()):
        raise InputError(
            f"no rig {rig!r}; available: {', '.join(rig_names())}, or a rig file (*.toml)"
        )
    if rate_hz is not None and rig not in BUILT_IN:
        raise InputError(f"--rate-hz is for {', '.join(BUILT_IN)}, not for {rig}")
    if object_name is not None and object_name not in OBJECTS:
        raise InputError(f"no simulated object {object_name!r}; available: {', '.join(OBJECTS)}")
    if station is not None:
        check_printable(station, what="--station")
    _check_ports_differ(port=port, opcua=opcua, modbus=modbus)
    known = () if users is None else read_users(users)
    _check_certificate(certificate, key)
    settings = Settings(
        rigs=tuple(dict.fromkeys((rig, *rig_names()))),
        objects=tuple(OBJECTS),
        folder=folder,
        store=store,
        object_name=object_name,
        seed=seed,
        speed=speed,
        rate_hz=rate_hz,
        damage=None if damage is None else DamageFile.load(damage),
        damage_path=damage,
        rules=None if rules is None else _read_rules(rules),
        words=words,
        requires_item=require_item,
        exit_after_s=exit_after_s,
        station=station,
        reference=None if reference is None else Conversion.load(reference),
        keep_days=keep_days,
    )
    items = ItemStore(store)
    items.check_usable()
    if rules is not None and settings.rules is not None:
        _warn_of_names(settings.rules, items=items, path=rules)
    existing = settings.existing_folder
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"--folder {folder}: {existing} is not a writable folder; choose another")
    serve_page(
        settings,
        # IPv6 addresses may be given in brackets.
        host=host.strip("[]"),
        port=port,
        token=token,
        users=known,
        certificate=certificate,
        key=key,
        announce=lambda address: print(f"palpate serve: {address}  (Ctrl-C ends it)", flush=True),
        publisher=None if mqtt is None else _open_publisher(mqtt, store=store),
        lines=open_lines(opcua=opcua, modbus=modbus, token=token, folder=folder, users=known),
    )


def _check_ports_differ(*, port: int, opcua: str | None, modbus: str | None) -> None:
    """Raise `InputError` if two protocols have the same port."""
    given = {"--opcua": opcua, "--modbus": modbus}
    taken = {port: "--port"}
    for name, text in given.items():
        if text is None or not (own := parse_address(text, option=name)[1]):
            continue
        if own in taken:
            raise InputError(
                f"{name} {text}: {taken[own]} has port {own} too; give each protocol its own"
            )
        taken[own] = name


def _check_certificate(certificate: Path | None, key: Path | None) -> None:
    """Raise `InputError` unless certificate and key are missing or fit each other."""
    if certificate is None and key is None:
        return
    if certificate is None or key is None:
        raise InputError("--certificate and --key: give both")
    try:
        ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(certificate, key)
    except OSError as error:
        raise InputError(f"--certificate {certificate}, --key {key}: {error}") from error


def _open_publisher(file: Path, *, store: str | None) -> Publisher:
    """Connect to a broker; results wait in the store until it acknowledges them."""
    from palpate_station.dashboard.audit import LOG
    from palpate_station.mqtt.broker import read_broker
    from palpate_station.mqtt.publisher import Publisher

    return Publisher(
        read_broker(file),
        store=store,
        on_error=LOG.error,
        on_return=LOG.info,
    )


def _read_rules(path: Path) -> RuleBook:
    """Read the sorting rules; requires the extra `produce`."""
    import sqlalchemy

    del sqlalchemy
    from palpate_station.sorting.rules_file import read_rules

    return read_rules(path)


def _warn_of_names(book: RuleBook, *, items: ItemStore, path: Path) -> None:
    """Warn of classes and stages that no item can have yet; items labelled with them may follow."""
    from palpate_station.ripeness.stages import STAGES
    from palpate_station.sorting.rules_file import unknown_stages, unlearned_classes

    known_stages = items.known_stages() if book.has_condition("ripeness") else ()
    for fault in unknown_stages(book, known_stages=known_stages, path=path):
        print_message(
            f"palpate: {fault}, so only an item labelled with it can meet it; check the name "
            f"({', '.join(STAGES)})"
        )
    known_kinds = items.learnt_kinds() if book.has_condition("class") else ()
    for fault in unlearned_classes(book, known_kinds=known_kinds, path=path):
        print_message(
            f"palpate: {fault}, so only an item whose kind was stated can meet it; check the name, "
            "or grasp and label items of it: palpate items NAME --set kind=KIND"
        )


def open_lines(
    *,
    opcua: str | None,
    modbus: str | None,
    token: str | None,
    folder: Path,
    users: Sequence[User] = (),
) -> list[LineOpener]:
    """Return openers for the requested protocols.

    Raises `InputError` if an address is invalid, or OPC UA would be reachable from other machines
    without a token; `DeviceError` if a port is taken.
    """
    openers: list[LineOpener] = []
    if opcua is not None:
        from palpate_station.dashboard.audit import record_refusal
        from palpate_station.line.opcua import USER, OpcUaStation

        host, port = _parse_unused_address("--opcua", opcua)
        passwords = {user.name: user.token if user.role.may_drive else "" for user in users}
        if token:
            passwords[USER] = token
        if host not in _LOOPBACK and not passwords:
            raise InputError(
                f"--opcua {host}:{port}: other machines could move the gripper; add --token, the "
                f"password of user {USER}, or --users"
            )
        station = partial(
            OpcUaStation, passwords=passwords, folder=folder, on_refused=record_refusal
        )
        text = "OPC UA at opc.tcp://{}:{}/palpate"
        openers.append(partial(_start, station_of=station, host=host, port=port, text=text))
    if modbus is not None:
        from palpate_station.line.modbus import ModbusStation

        host, port = _parse_unused_address("--modbus", modbus)
        text = "Modbus TCP at {}:{}"
        openers.append(partial(_start, station_of=ModbusStation, host=host, port=port, text=text))
    return openers


def _parse_unused_address(option: str, text: str) -> tuple[str, int]:
    """Parse ``[HOST:]PORT``; raise `DeviceError` if the address can't be bound."""
    from palpate_station.dashboard.listening import bind_fault

    host, port = parse_address(text, option=option)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Checked before the devices are opened, because a later error would leave them running.
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise DeviceError(
                f"{option} {text}: {bind_fault(error)}; give another address"
            ) from error
    return host, port


async def _start(
    machine: Machine,
    *,
    station_of: Callable[[Machine], OpcUaStation | ModbusStation],
    host: str,
    port: int,
    text: str,
) -> Line:
    """Start a station and print its host and port in the format `text`."""
    station = station_of(machine)
    try:
        actual_port = await station.start(host, port)
    except (OSError, RuntimeError) as error:
        raise DeviceError(
            f"{text.format(host, port)} can't start ({error}); give each protocol a port of its own"
        ) from error
    print_message(f"palpate serve: {text.format(host, actual_port)}")
    return station
