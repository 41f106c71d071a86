"""Serve a station over OPC UA: state, last result and methods (docs: Connect a packhouse)."""

from __future__ import annotations

import hmac
import json
import logging
import math
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeAlias

from palpate.errors import InputError, require_extra
from palpate.grasp.document import GraspDocument
from palpate_station.line.machine import CommandRefusedError, Machine, line_state
from palpate_station.line.results import (
    MEASUREMENTS,
    PARTS,
    list_measurements,
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
#: Types of the arguments of `Grasp`, in order; strings may be null.
_GRASP_TYPES: tuple[Any, ...] = (float, (str, type(None)), (str, type(None)), int)

#: Driver name of this protocol.
DRIVER = "opcua"
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
    "State": (ua.VariantType.String, lambda state: line_state(state).name.lower()),
    "StateNumber": (ua.VariantType.Int32, lambda state: int(line_state(state))),
    "Activity": (ua.VariantType.String, lambda state: state["activity"]),
    "Phase": (ua.VariantType.String, lambda state: state["phase"] or ""),
    "Fresh": (ua.VariantType.Boolean, lambda state: bool(state["fresh"])),
    "HandOpen": (ua.VariantType.Boolean, lambda state: bool(state["hand_open"])),
    "Driven": (ua.VariantType.Boolean, lambda state: bool(state["driver"])),
    "Simulated": (ua.VariantType.Boolean, lambda state: bool(state["simulated"])),
    "Stops": (ua.VariantType.Int64, lambda state: int(state["stops"])),
    "Trouble": (ua.VariantType.String, lambda state: state["trouble"] or ""),
}
#: Result variable -> type and function of the grasp document (None before the first grasp).
_RESULT: dict[str, tuple[ua.VariantType, Callable[[GraspDocument], Any]]] = {
    "Outcome": (ua.VariantType.String, lambda found: str(found.result.outcome)),
    "Item": (ua.VariantType.String, lambda found: found.item_id),
    "Bin": (ua.VariantType.String, lambda found: found.bin_name),
    "BinProvisional": (ua.VariantType.Boolean, lambda found: found.needs_regrasp),
    "NotStored": (ua.VariantType.String, lambda found: found.not_stored),
    "Document": (
        ua.VariantType.String,
        lambda found: json.dumps(found.to_dict(), allow_nan=False),
    ),
}


class _PasswordUserManager(UserManager):
    """User manager with the single user `USER`."""

    def __init__(self, password: str) -> None:
        self._password = password.encode()

    def get_user(
        self,
        iserver: Any,
        username: str | None = None,
        password: str | None = None,
        certificate: Any = None,
    ) -> User | None:
        """Return the user if the credentials are correct, otherwise None."""
        is_correct = hmac.compare_digest((password or "").encode(), self._password)
        return User(role=UserRole.User, name=USER) if username == USER and is_correct else None


class OpcUaStation:
    """OPC UA server of a machine.

    `machine`: its methods are called on the event loop that runs `start`.
    `password`: password of the user ``palpate``; None allows anonymous access without encryption.
    `folder`: folder of the server certificate, which is created at the first start.
    """

    def __init__(self, machine: Machine, *, password: str | None, folder: Path) -> None:
        self._machine, self._password, self._folder = machine, password, folder
        self._server = Server(
            user_manager=None if password is None else _PasswordUserManager(password)
        )
        #: Nodes with their types, and the last written values, by variable name.
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
        if self._password is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        else:
            await self._enable_encryption(host)
        await self._add_nodes(await server.register_namespace(NAMESPACE))
        await self.refresh()
        await server.start()
        listening: Any = server.bserver
        return int(listening._server.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """Close every session."""
        await self._server.stop()

    async def refresh(self) -> None:
        """Write the changed variables, which notifies subscribed clients."""
        state = self._machine.state()
        for name, (_, value_of) in _STATE.items():
            await self._write(name, value_of(state))
        number, result = self._machine.result()
        if number == self._results:
            return
        self._results = number
        for name, value in zip(_measurement_names(), list_measurements(result), strict=True):
            await self._write(name, value)
        for name, (kind, value_of) in _RESULT.items():
            await self._write(name, _INITIAL_VALUES[kind] if result is None else value_of(result))
        # Written last, so that a client that waits for a new number reads a complete result.
        await self._write("Number", number)

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
        station = await self._server.nodes.objects.add_object(space, "Station")
        result = await station.add_object(space, "Result")
        text, number = ua.VariantType.String, ua.VariantType.Double
        of_state = {name: kind for name, (kind, _) in _STATE.items()} | {"Refusal": text}
        of_result = {name: kind for name, (kind, _) in _RESULT.items()}
        of_result |= {"Number": ua.VariantType.Int64} | dict.fromkeys(_measurement_names(), number)
        for parent, kinds in ((station, of_state), (result, of_result)):
            for name, kind in kinds.items():
                node = await parent.add_variable(
                    space, name, _INITIAL_VALUES[kind], varianttype=kind
                )
                self._nodes[name] = node, kind
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
                ],
                [_argument("Recording", text, "name of the recording")],
            ),
            ("Release", self._release, [], []),
            ("Stop", self._stop, [], [_argument("Stopped", ua.VariantType.Boolean, "confirmed")]),
            ("TakeOver", self._take_over, [], []),
            ("Leave", self._leave, [], []),
        ):
            await station.add_method(space, name, method, inputs, outputs)

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
        if len(values) != len(_GRASP_TYPES):
            return _status(StatusCodes.BadArgumentsMissing)
        if not all(isinstance(*pair) for pair in zip(values, _GRASP_TYPES, strict=True)):
            return _status(StatusCodes.BadTypeMismatch)
        target, item, kind, stops = values
        return await self._run_command(
            self._machine.grasp(
                DRIVER,
                target_force_n=None if target == 0 else target,
                item_id=item or "",
                kind=kind or "",
                stops=None if stops < 0 else stops,
            )
        )

    async def _release(self, parent: Any) -> _Answer:
        return await self._run_command(self._machine.release(DRIVER))

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
        is_stopped = await self._machine.stop()
        await self.refresh()
        return [ua.Variant(is_stopped, ua.VariantType.Boolean)]

    async def _take_over(self, parent: Any) -> _Answer:
        return await self._run_command(self._machine.take_over(DRIVER))

    async def _leave(self, parent: Any) -> _Answer:
        return await self._run_command(self._machine.leave(DRIVER))


def _measurement_names() -> list[str]:
    """Return the variable names of the measurements: `SizeMm`, `SizeMmLow`, `SizeMmHigh` etc."""
    names = []
    for measurement in MEASUREMENTS:
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
