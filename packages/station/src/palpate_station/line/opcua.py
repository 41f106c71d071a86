"""Serve a station over OPC UA: state, last result and methods (docs: Connect a packhouse)."""

from __future__ import annotations

import asyncio
import hmac
import json
import logging
import math
import socket
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from palpate.errors import InputError, require_extra
from palpate.grasp.document import GraspDocument
from palpate_station.line.machine import CommandRefusedError, Machine
from palpate_station.line.results import (
    MEASUREMENTS,
    OUTCOME_NUMBERS,
    PARTS,
    list_held,
    list_measurements,
    list_reference,
)

with require_extra("--opcua", extra="line", package="palpate-station"):
    from asyncua import ua
    from asyncua.common.node import Node
    from asyncua.crypto.cert_gen import setup_self_signed_certificate
    from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole
    from asyncua.server.server import Server
    from asyncua.server.user_managers import UserManager
    from asyncua.ua.status_codes import StatusCodes
    from cryptography.x509.oid import ExtendedKeyUsageOID

#: Output arguments of a method, or the status code of a refusal.
_Answer: TypeAlias = "list[ua.Variant] | ua.StatusCode"
#: Types of the arguments of `Grasp`, in order; strings may be null. Clients may omit the last one.
_GRASP_TYPES: tuple[Any, ...] = (
    float,
    (str, type(None)),
    (str, type(None)),
    int,
    (str, type(None)),
)

#: Driver name of this protocol's clients, before the address.
DRIVER = "OPC UA"
#: TCP options of Linux: probe after 2 s of silence, each second; close after 5 s without an answer.
_KEEPALIVE = {
    "TCP_KEEPIDLE": 2,
    "TCP_KEEPINTVL": 1,
    "TCP_KEEPCNT": 3,
    "TCP_USER_TIMEOUT": 5000,
}
NAMESPACE, APPLICATION = "urn:palpate:station", "urn:palpate:server"
#: Username for the login; the password is the token.
USER = "palpate"
#: Initial values of variables, by type.
_INITIAL_VALUES: dict[ua.VariantType, Any] = {
    ua.VariantType.String: "",
    ua.VariantType.Int32: 0,
    ua.VariantType.Int64: 0,
    ua.VariantType.Boolean: False,
    ua.VariantType.Double: math.nan,
}
#: State variable -> type and function of the state document.
_STATE: dict[str, tuple[ua.VariantType, Callable[[Any], Any]]] = {
    "State": (ua.VariantType.String, lambda state: state["state"]),
    "StateNumber": (ua.VariantType.Int32, lambda state: state["state_number"]),
    "Activity": (ua.VariantType.String, lambda state: state["activity"]),
    "Phase": (ua.VariantType.String, lambda state: state["phase"] or ""),
    "Fresh": (ua.VariantType.Boolean, lambda state: bool(state["fresh"])),
    "HandOpen": (ua.VariantType.Boolean, lambda state: bool(state["hand_open"])),
    "Driven": (ua.VariantType.Boolean, lambda state: bool(state["driver"])),
    "Driver": (ua.VariantType.String, lambda state: state["driver_name"] or ""),
    "Simulated": (ua.VariantType.Boolean, lambda state: bool(state["simulated"])),
    "Stops": (ua.VariantType.Int64, lambda state: int(state["stops"])),
    "Trouble": (ua.VariantType.String, lambda state: state["trouble"] or ""),
    "Interrupted": (ua.VariantType.Boolean, lambda state: state["interrupted"] is not None),
    "InterruptedItem": (
        ua.VariantType.String,
        lambda state: (state["interrupted"] or {}).get("item_id", ""),
    ),
}
#: Variable of the held object -> type and function of `held` of the state document (None before the
#: answer and after the release).
_HELD: dict[str, tuple[ua.VariantType, Callable[[Any], Any]]] = {
    "Item": (ua.VariantType.String, lambda held: held["item_id"]),
    "Bin": (ua.VariantType.String, lambda held: held["bin"] or ""),
    "BinProvisional": (ua.VariantType.Boolean, lambda held: held["again"]),
}
#: Result variable -> type and function of the grasp document (None before the first grasp).
_RESULT: dict[str, tuple[ua.VariantType, Callable[[GraspDocument], Any]]] = {
    "Outcome": (ua.VariantType.String, lambda found: str(found.result.outcome)),
    "OutcomeNumber": (ua.VariantType.Int32, lambda found: OUTCOME_NUMBERS[found.result.outcome]),
    "Item": (ua.VariantType.String, lambda found: found.item_id),
    "Bin": (ua.VariantType.String, lambda found: found.bin_name),
    "BinProvisional": (ua.VariantType.Boolean, lambda found: found.needs_regrasp),
    "NotStored": (ua.VariantType.String, lambda found: found.not_stored),
    "ReferenceUnit": (
        ua.VariantType.String,
        lambda found: str((found.reference or {}).get("unit", "")),
    ),
    "Document": (
        ua.VariantType.String,
        lambda found: json.dumps(found.to_dict(), allow_nan=False),
    ),
}


class _PasswordUserManager(UserManager):
    """User manager with a password for each username."""

    def __init__(self, passwords: Mapping[str, str], *, on_refused: Callable[[str], None]) -> None:
        self._passwords, self._on_refused = passwords, on_refused

    def get_user(
        self,
        iserver: Any,
        username: str | None = None,
        password: str | None = None,
        certificate: Any = None,
    ) -> User | None:
        """Return the user if the credentials are correct, otherwise None."""
        expected = self._passwords.get(username or "", "")
        is_correct = hmac.compare_digest((password or "").encode(), expected.encode())
        if expected and is_correct:
            return User(role=UserRole.User, name=username)
        why = "unknown user" if username not in self._passwords else "wrong password"
        if username in self._passwords and not expected:
            why = "role view"
        self._on_refused(f"login as {(username or '')[:40]!r}, {why}")
        return None


class OpcUaStation:
    """OPC UA server of a machine.

    `machine`: its methods are called on the event loop that runs `start`.
    `passwords`: password of each username, empty for one that may only watch; without usernames,
        access is anonymous and not encrypted.
    `folder`: folder of the server certificate, which is created at the first start.
    `on_refused`: called with the address of a client and the login that was refused.
    """

    def __init__(
        self,
        machine: Machine,
        *,
        passwords: Mapping[str, str],
        folder: Path,
        on_refused: Callable[[str, str], None],
    ) -> None:
        self._machine, self._is_open, self._folder = machine, not passwords, folder
        manager = _PasswordUserManager(
            passwords, on_refused=lambda what: on_refused(self._client(), what)
        )
        self._server = Server(user_manager=manager if passwords else None)
        #: Nodes with their types, and the last written values, by path below the station.
        self._nodes: dict[str, tuple[Node, ua.VariantType]] = {}
        self._shown: dict[str, Any] = {}
        self._results = -1

    async def start(self, host: str, port: int) -> int:
        """Start listening and return the port; port 0 selects a free port."""
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        server = self._server
        await server.init()
        server.set_endpoint(f"opc.tcp://{host}:{port}/palpate")
        server.set_server_name("palpate")
        await server.set_application_uri(APPLICATION)
        if self._is_open:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        else:
            await self._enable_encryption(host)
        await self._add_nodes(await server.register_namespace(NAMESPACE))
        await self.refresh()
        await server.start()
        listening: Any = server.bserver
        for one in listening._server.sockets:
            _detect_lost_clients(one)
        return int(listening._server.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """Close every session."""
        await self._server.stop()

    async def refresh(self) -> None:
        """Write the changed variables, which notifies subscribed clients."""
        for connection in getattr(self._server.bserver, "clients", ()):
            self._machine.renew(_client_name(connection))
        state = self._machine.state()
        held = state["held"]
        answers = list_held(held) + list_reference(held and held["reference"])
        for name, value in zip(_measurement_names(), answers, strict=True):
            await self._write(f"Held.{name}", value)
        for name, (kind, value_of) in _HELD.items():
            await self._write(
                f"Held.{name}", _INITIAL_VALUES[kind] if held is None else value_of(held)
            )
        # Written after the held object, so that a client that waits for `holding` reads its values.
        for name, (_, value_of) in _STATE.items():
            await self._write(name, value_of(state))
        number, result = self._machine.result()
        if number == self._results:
            return
        self._results = number
        answers = list_measurements(result) + list_reference(
            None if result is None else result.reference
        )
        for name, value in zip(_measurement_names(), answers, strict=True):
            await self._write(f"Result.{name}", value)
        for name, (kind, value_of) in _RESULT.items():
            shown = _INITIAL_VALUES[kind] if result is None else value_of(result)
            await self._write(f"Result.{name}", shown)
        # Written last, so that a client that waits for a new number reads a complete result.
        await self._write("Result.Number", number)

    async def _enable_encryption(self, host: str) -> None:
        key, certificate = self._folder / "opcua-key.pem", self._folder / "opcua-certificate.der"
        self._folder.mkdir(parents=True, exist_ok=True)
        await setup_self_signed_certificate(
            key,
            certificate,
            APPLICATION,
            host,
            [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH],
            {"organizationName": "palpate", "commonName": "palpate"},
        )
        key.chmod(0o600)
        await self._server.load_certificate(str(certificate))
        await self._server.load_private_key(str(key))
        self._server.set_security_policy(
            [ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt],
            permission_ruleset=SimpleRoleRuleset(),
        )
        self._server.set_security_IDs(["Username"])

    async def _add_nodes(self, space: int) -> None:
        def names(path: str) -> tuple[ua.NodeId, ua.QualifiedName]:
            # Clients save node IDs, so those must not depend on the number of nodes before.
            named = ua.QualifiedName(path.rpartition(".")[2], space)
            return ua.NodeId.from_string(f"ns={space};s={path}"), named

        station = await self._server.nodes.objects.add_object(*names("Station"))
        held = await station.add_object(*names("Station.Held"))
        result = await station.add_object(*names("Station.Result"))
        text, number = ua.VariantType.String, ua.VariantType.Double
        of_state = {name: kind for name, (kind, _) in _STATE.items()} | {"Refusal": text}
        measured = dict.fromkeys(_measurement_names(), number)
        of_held = {name: kind for name, (kind, _) in _HELD.items()} | measured
        of_result = {name: kind for name, (kind, _) in _RESULT.items()} | measured
        of_result |= {"Number": ua.VariantType.Int64}
        for parent, path, kinds in (
            (station, "", of_state),
            (held, "Held.", of_held),
            (result, "Result.", of_result),
        ):
            for name, kind in kinds.items():
                node = await parent.add_variable(
                    *names(f"Station.{path}{name}"), _INITIAL_VALUES[kind], varianttype=kind
                )
                self._nodes[path + name] = node, kind
        for name, method, inputs, outputs in (
            (
                "Grasp",
                self._grasp,
                [
                    _argument("TargetForceN", number, "0 for a gentle squeeze"),
                    _argument("Item", text, "empty for none"),
                    _argument("Kind", text, "of produce, for its damage limit; empty for none"),
                    _argument(
                        "Stops", ua.VariantType.Int64, "last known number of stops; -1 to ignore"
                    ),
                    _argument("Batch", text, "of the item; may be omitted"),
                ],
                [_argument("Recording", text, "name of the recording")],
            ),
            ("Release", self._release, [], []),
            ("Stop", self._stop, [], [_argument("Stopped", ua.VariantType.Boolean, "confirmed")]),
            ("TakeOver", self._take_over, [], []),
            ("Leave", self._leave, [], []),
        ):
            await station.add_method(*names(f"Station.{name}"), method, inputs, outputs)

    async def _write(self, name: str, value: Any) -> None:
        shown = self._shown.get(name)
        # NaN is not equal to itself.
        if name in self._shown and (shown == value or (shown != shown and value != value)):
            return
        self._shown[name] = value
        node, kind = self._nodes[name]
        await node.write_value(ua.Variant(value, kind))

    # -- OPC UA methods, which return their output arguments or a status code --------------------

    async def _grasp(self, parent: Any, *arguments: ua.Variant) -> _Answer:
        values = [variant.Value for variant in arguments]
        if len(values) == len(_GRASP_TYPES) - 1:
            values.append(None)
        if len(values) != len(_GRASP_TYPES):
            await self._write("Refusal", f"Grasp has {len(values)} arguments, not 4 or 5")
            return _status(StatusCodes.BadArgumentsMissing)
        if not all(isinstance(*pair) for pair in zip(values, _GRASP_TYPES, strict=True)):
            await self._write(
                "Refusal", "the arguments of Grasp must be Double, String, String, Int64, String"
            )
            return _status(StatusCodes.BadTypeMismatch)
        target, item, kind, stops, batch = values
        return await self._run_command(
            self._machine.grasp(
                self._client(),
                target_force_n=None if target == 0 else target,
                item_id=item or "",
                kind=kind or "",
                stops=None if stops < 0 else stops,
                batch=batch or "",
            )
        )

    async def _release(self, parent: Any) -> _Answer:
        return await self._run_command(self._machine.release(self._client()))

    def _client(self) -> str:
        """Return the name of the client that has called the running method."""
        # Each connection answers its requests in a task of its own.
        task = asyncio.current_task()
        connections = getattr(self._server.bserver, "clients", ())
        return next((_client_name(one) for one in connections if one._task is task), DRIVER)

    async def _run_command(self, command: Awaitable[str | None]) -> _Answer:
        """Execute a command; a refusal returns a status and writes the reason to `Refusal`.

        The variables are updated before the answer, so a client that has the answer reads the new
        state.
        """
        refusal = ""
        answer: _Answer
        try:
            text = await command
            answer = [] if text is None else [ua.Variant(text, ua.VariantType.String)]
        except CommandRefusedError as error:
            refusal, answer = str(error), _status(StatusCodes.BadInvalidState)
        except InputError as error:
            refusal, answer = str(error), _status(StatusCodes.BadInvalidArgument)
        await self._write("Refusal", refusal)
        await self.refresh()
        return answer

    async def _stop(self, parent: Any) -> list[ua.Variant]:
        is_stopped = await self._machine.stop(self._client())
        await self.refresh()
        return [ua.Variant(is_stopped, ua.VariantType.Boolean)]

    async def _take_over(self, parent: Any) -> _Answer:
        return await self._run_command(self._machine.take_over(self._client()))

    async def _leave(self, parent: Any) -> _Answer:
        return await self._run_command(self._machine.leave(self._client()))


def _detect_lost_clients(listening: socket.socket) -> None:
    """Close connections whose client has lost its network; connections inherit the options."""
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _KEEPALIVE.items():
        if hasattr(socket, name):
            listening.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def _client_name(connection: Any) -> str:
    """Return the username of a connection; without one, and of the token's user, its address."""
    session = connection.processor and connection.processor.session
    name = session and session.user and session.user.name
    if name and name != USER:
        return str(name)
    return f"{DRIVER} {connection.peer_name[0]}" if connection.peer_name else DRIVER


def _measurement_names() -> list[str]:
    """Return the variable names of the measurements: `SizeMm`, `SizeMmLow`, `SizeMmHigh` etc."""
    names = []
    for measurement in (*MEASUREMENTS, "reference"):
        stem = "".join(word.capitalize() for word in measurement.split("_"))
        names += [stem + ("" if part == "value" else part.capitalize()) for part in PARTS]
    return names


def _argument(name: str, kind: ua.VariantType, about: str) -> ua.Argument:
    return ua.Argument(
        Name=name,
        DataType=ua.NodeId(ua.Int32(kind.value)),
        ValueRank=-1,
        Description=ua.LocalizedText(about),
    )


def _status(code: int) -> ua.StatusCode:
    return ua.StatusCode(ua.UInt32(code))
