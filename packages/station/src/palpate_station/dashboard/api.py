"""HTTP and JSON API, described by OpenAPI, with the same access rules as the page."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import Depends, FastAPI, HTTPException, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from fastapi.responses import JSONResponse, Response
from fastapi.routing import APIRoute
from pydantic import BaseModel, ConfigDict, Field

import palpate_station
from palpate.errors import InputError, PalpateError
from palpate.grasp.safety import FORCE_CEILING_N
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.audit import LOG, record_event
from palpate_station.dashboard.grasp_form import check_item
from palpate_station.dashboard.item_store import error_text
from palpate_station.dashboard.monitor import Monitor
from palpate_station.line.machine import CommandRefusedError
from palpate_station.line.results import NO_ITEM
from palpate_station.records import Item

_SCHEMAS = Path(palpate_station.__file__).parent / "schemas"
_SCHEMA_NAMES = ("measurement", "grasp", "state", "items", "item")


class GraspRequest(BaseModel):
    """Item and target force of a grasp."""

    model_config = ConfigDict(extra="forbid", strict=True)

    target_force_n: float | None = Field(
        None,
        gt=0,
        le=FORCE_CEILING_N,
        description="Grip force, newtons; a gentle squeeze if omitted.",
    )
    item_id: str = Field(
        "", max_length=80, description="Name of the item; the grasp is not stored if omitted."
    )
    kind: str = Field("", max_length=80, description="Kind of produce, for its damage limit.")
    batch: str = Field(
        "", max_length=80, description="Batch of the item; that of the page if omitted."
    )
    stops: int | None = Field(
        None,
        ge=0,
        description="Last known `stops` of the state; the grasp is refused if it is another one "
        "now, after a stop or a restart.",
    )


class ItemChange(BaseModel):
    """What a person states about an item; omitted fields stay as they are."""

    model_config = ConfigDict(extra="forbid", strict=True)

    kind: str | None = Field(None, min_length=1, max_length=80)
    batch: str | None = Field(None, min_length=1, max_length=80)
    label: str | None = Field(None, min_length=1, max_length=200, description="A note for people.")
    labels: dict[Literal["ripeness", "bruise", "identity", "bin"], str] = Field(
        default_factory=dict,
        description="Labels of the item as it is now, as training data: a stage of ripeness, "
        "`bruised` or `sound`, a bin of the rules file, or any name of a kind.",
    )


class GraspStarted(BaseModel):
    """A grasp has been ordered."""

    recording: str = Field(description="Name of the recording; the result has the same name.")
    not_stored: str | None = Field(
        description="Reason why the grasp will not be stored; null if it will be."
    )


class Stopped(BaseModel):
    """The response to a stop."""

    stopped: bool = Field(
        description="Whether the devices confirmed that the hand received the stop."
    )


class Released(BaseModel):
    """The hand has been ordered to open."""

    accepted: bool


class Health(BaseModel):
    """Whether a station can be used."""

    healthy: bool = Field(description="Whether it can grasp and store.")
    problems: list[str] = Field(
        description="One line for each. If healthy, these don't keep the station from grasping and "
        "storing: a broker or a shared store that does not answer."
    )
    version: str
    uptime_s: float
    state: str = Field(description="As in the state document.")
    activity: str
    fresh: bool
    simulated: bool | None
    rig: str | None


class _JsonRoute(APIRoute):
    """A route that names what is wrong with a body that can't be JSON.

    The framework would validate the bytes as they are, and describe its own types.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler with the checks."""
        handle = super().get_route_handler()

        async def check_and_handle(request: Request) -> Response:
            """Refuse a body without its header, or in another encoding."""
            if self.body_field is not None and (body := await request.body()):
                kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
                if kind != "application/json" and not kind.endswith("+json"):
                    sent = f"not {kind[:40]!r}" if kind else "which is missing"
                    detail = f"header Content-Type: must be application/json, {sent}"
                    raise HTTPException(422, detail)
                try:
                    body.decode()
                except UnicodeDecodeError as error:
                    raise HTTPException(
                        422, f"body: not UTF-8 at byte {error.start}; send JSON in UTF-8"
                    ) from error
            return await handle(request)

        return check_and_handle


class Refusal(BaseModel):
    """The reason of a refusal."""

    detail: str = Field(description="One line with the problem and the remedy.")


def client_name(request: Request) -> str:
    """Return the name of an API client as a driver: its user, or else its address."""
    user = request.scope.get("palpate_user")
    if user is not None and user.name:
        return str(user.name)
    return f"HTTP {request.client.host}" if request.client is not None else "HTTP"


Client = Annotated[str, Depends(client_name)]


def build_api(app_state: AppState, monitor: Monitor, *, token: bool) -> FastAPI:
    """Return the API application; `token`: whether clients must send a token."""

    async def renew(request: Request, client: Client) -> None:
        """Extend the control of the driver with each of its requests."""
        # Whoever watches over the station is no driver.
        if not request.url.path.endswith("/health"):
            app_state.renew(client)

    api = FastAPI(
        title="palpate",
        dependencies=[Depends(renew)],
        version="1",
        docs_url=None,
        redoc_url=None,
        responses=_refusals(401, 403, 429) if token else {},
    )
    api.openapi = cache(lambda: _describe(api, token=token))  # type: ignore[method-assign]
    api.router.route_class = _JsonRoute
    _add_validation_handler(api)
    _add_queries(api, app_state)
    _add_health(api, monitor)
    _add_orders(api, app_state)
    return api


def _add_queries(api: FastAPI, app_state: AppState) -> None:
    """Add the read-only routes."""

    @api.get("/state", responses=_documents("state"))
    async def state() -> JSONResponse:
        """Current activity, and whether a grasp can start."""
        return JSONResponse(app_state.state())

    @api.get("/result", responses=_documents("grasp") | _refusals(404))
    async def result() -> JSONResponse:
        """The last grasp of this run, in the format of `palpate grasp --json`."""
        _, last = app_state.result()
        if last is None:
            raise HTTPException(404, "no grasp has ended since palpate serve was started")
        return JSONResponse(last.to_dict())

    # Plain functions run in worker threads, because a store may be slow or not answer.
    @api.get("/items", responses=_documents("items") | _refusals(503))
    def items(limit: Annotated[int, Query(ge=1, le=1000)] = 50) -> JSONResponse:
        """Items of the store, last grasped first, in the format of `palpate items --json`."""
        from palpate_station.store.item_history import items_document

        with _translate_errors():
            return JSONResponse(items_document(app_state.item_store.pages(limit=limit)))

    @api.get("/items/{item_id:path}", responses=_documents("item") | _refusals(404, 503))
    def item(item_id: str) -> JSONResponse:
        """One item with its grasps, in the format of `palpate items ITEM --json`."""
        from palpate_station.store.item_history import item_document

        with _translate_errors():
            Item(item_id=item_id)
            return JSONResponse(item_document(app_state.item_store.page(item_id)))

    @api.patch("/items/{item_id:path}", responses=_documents("item") | _refusals(503))
    def change_item(item_id: str, body: ItemChange, client: Client) -> JSONResponse:
        """State kind, batch or note of an item, or label it; a new item is added."""
        from palpate_station.store.item_history import item_document

        with _translate_errors(bad_value=422):
            item_id = check_item(item_id)
            facts = body.model_dump()
            labels: dict[str, str] = facts.pop("labels")
            page = app_state.item_store.change(
                Item(item_id=item_id, **facts), labels=labels, by=client
            )
        stated = [f"{name}={text}" for name, text in (facts | labels).items() if text]
        record_event(client, f"label {item_id} {' '.join(stated)}")
        return JSONResponse(item_document(page))

    @api.get("/epcis/{item_id:path}", responses=_refusals(404, 503))
    def epcis(item_id: str) -> JSONResponse:
        """The grasps of one item as EPCIS 2.0 events in JSON-LD."""
        from palpate_station.line.epcis import epcis_document

        with _translate_errors():
            Item(item_id=item_id)
            history = app_state.item_store.page(item_id)
            return JSONResponse(epcis_document(history, created_at=datetime.now(UTC)))


def _add_health(api: FastAPI, monitor: Monitor) -> None:
    @api.get("/health", responses={503: {"model": Health}})
    def health() -> Health:
        """Whether the station can grasp and store; 503 with the problems if it can't."""
        found = Health(**monitor.health())
        status = 200 if found.healthy else 503
        return JSONResponse(found.model_dump(), status_code=status)  # type: ignore[return-value]


def _add_orders(api: FastAPI, app_state: AppState) -> None:
    """Add the command routes, with the same rules as on the page."""

    @api.post("/grasp", status_code=202, responses=_refusals(400, 409))
    async def grasp(body: GraspRequest, client: Client) -> GraspStarted:
        """Start a grasp; the object is held until its release, at most for one minute."""
        with _translate_errors(bad_value=422):
            recording = await app_state.grasp(client, **body.model_dump())
        return GraspStarted(recording=recording, not_stored=None if body.item_id else NO_ITEM)

    @api.post("/release", status_code=202, responses=_refusals(409))
    async def release(client: Client) -> Released:
        """Release the object, or open the hand; `hand_open` of the state reports the end."""
        with _translate_errors():
            await app_state.release(client)
        return Released(accepted=True)

    @api.put("/driver", status_code=204)
    async def take_over(client: Client) -> None:
        """Take control, even from another driver; it ends 5 s after the last request."""
        await app_state.take_over(client)

    @api.delete("/driver", status_code=204)
    async def leave(client: Client) -> None:
        """Release control."""
        await app_state.leave(client)

    @api.post("/stop", responses={504: {"model": Stopped}})
    async def stop(client: Client) -> JSONResponse:
        """Stop all movement, also without control; 504 without a confirmation."""
        stopped = await app_state.stop(client)
        return JSONResponse({"stopped": stopped}, status_code=200 if stopped else 504)


@contextmanager
def _translate_errors(*, bad_value: int = 404) -> Iterator[None]:
    try:
        yield
    except CommandRefusedError as error:
        raise HTTPException(409, str(error)) from error
    except InputError as error:
        raise HTTPException(bad_value, str(error)) from error
    except PalpateError as error:
        LOG.error("%s", error)
        raise HTTPException(503, error_text(error)) from error


def _add_validation_handler(api: FastAPI) -> None:
    """Answer invalid requests with one line that names the invalid field."""

    @api.exception_handler(RequestValidationError)
    async def refuse(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        if first["type"] == "model_attributes_type":
            return JSONResponse({"detail": f"{where}: must be a JSON object"}, status_code=422)
        return JSONResponse({"detail": f"{where}: {first['msg']}"}, status_code=422)


# -- OpenAPI description ------------------------------------------------------------------------


def _documents(name: str) -> dict[int | str, dict[str, Any]]:
    schema = {"$ref": f"#/components/schemas/{name}"}
    return {200: {"content": {"application/json": {"schema": schema}}}}


def _refusals(*statuses: int) -> dict[int | str, dict[str, Any]]:
    return {status: {"model": Refusal} for status in statuses}


def _describe(api: FastAPI, *, token: bool) -> dict[str, Any]:
    """Return the OpenAPI document, which includes the published schemas unchanged."""
    about = (
        "Start and stop grasps, and read their results. Any client may stop the hand; all other "
        "commands require control."
    )
    found = get_openapi(
        title=api.title,
        version=api.version,
        description=about,
        routes=api.routes,
        servers=[{"url": "/api/v1"}],
    )
    components = found["components"]
    components["schemas"] |= {name: _load_schema(name) for name in _SCHEMA_NAMES}
    for operation in (one for path in found["paths"].values() for one in path.values()):
        if 422 in map(int, operation["responses"]):
            refused = operation["responses"]["422"]["content"]["application/json"]
            refused["schema"] = {"$ref": "#/components/schemas/Refusal"}
    for unused in ("HTTPValidationError", "ValidationError"):
        components["schemas"].pop(unused, None)
    if token:
        components["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        found["security"] = [{"token": []}]
    return found


def _load_schema(name: str) -> dict[str, Any]:
    """Return a published schema with its references adapted to the OpenAPI components."""
    text = (_SCHEMAS / f"{name}.json").read_text(encoding="utf-8")
    for schema_name in _SCHEMA_NAMES:
        text = text.replace(
            f'"$ref": "{schema_name}.json"', f'"$ref": "#/components/schemas/{schema_name}"'
        )
    schema: dict[str, Any] = json.loads(text)
    return {key: value for key, value in schema.items() if key not in ("$schema", "$id")}
