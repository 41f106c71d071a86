"""Database engine of a store, and one-line errors."""

from __future__ import annotations

import os
import sqlite3
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

import sqlalchemy as sa

from palpate.errors import InputError, StoreAwayError, StoreError, require_extra

#: Environment variable with the store, and default file name.
STORE_VARIABLE = "PALPATE_STORE"
DEFAULT_STORE = "palpate-items.sqlite"
#: Maximum wait of a writer for other writers, seconds. A write takes milliseconds.
LOCK_TIMEOUT_S = 10.0
_CONNECT_TIMEOUT_S = 5
#: Interval of attempts to get a lock, seconds.
_LOCK_RETRY_S = 0.01


class StoreDiskError(StoreAwayError):
    """The disk of a store is full or has failed."""


#: Start of SQLite's error name -> error; cause and remedy.
_SQLITE_FAULTS: Mapping[str, tuple[type[StoreError], str]] = {
    "SQLITE_BUSY": (
        StoreAwayError,
        "locked by another program for {wait:g} s; close it and try again",
    ),
    "SQLITE_LOCKED": (
        StoreAwayError,
        "locked by another program for {wait:g} s; close it and try again",
    ),
    "SQLITE_FULL": (StoreDiskError, "the disk is full; make room and try again"),
    "SQLITE_IOERR": (
        StoreDiskError,
        "the disk is full or has failed; make room or check it, and try again",
    ),
    "SQLITE_READONLY": (
        StoreError,
        "is read-only; change the permissions of the file and its folder",
    ),
    "SQLITE_PERM": (
        StoreError,
        "access denied; change the permissions of the file and its folder",
    ),
    "SQLITE_NOTADB": (StoreError, "not a store (no SQLite database); name another file"),
    "SQLITE_CORRUPT": (
        StoreError,
        "is damaged; restore it from a backup, or try `sqlite3 FILE .recover`",
    ),
    "SQLITE_CANTOPEN": (StoreError, "can't be opened; check the folder and its permissions"),
}
#: The same for PostgreSQL, by the start of SQLSTATE (appendix A of its manual).
_POSTGRESQL_FAULTS: Mapping[str, tuple[type[StoreError], str]] = {
    "53100": (StoreDiskError, "the server's disk is full; make room and try again"),
    "55P03": (StoreAwayError, "locked by another program for {wait:g} s; close it and try again"),
    "57P": (StoreAwayError, "the server is shutting down or starting; try again"),
    "53": (StoreAwayError, "the server is out of connections or memory; try again later"),
    "40": (StoreAwayError, "two writers were in conflict; try again"),
    "08": (StoreAwayError, "the connection was lost; check the server and try again"),
    "25006": (StoreError, "the server is read-only; name the primary server"),
    "28": (StoreError, "the server refused the user or password; check the URL"),
    "3D000": (StoreError, "no such database on the server; create it with `createdb`"),
    "42501": (
        StoreError,
        "the user lacks permissions; request CREATE, SELECT, INSERT and UPDATE",
    ),
}


def store_url(where: str | Path | None) -> sa.URL:
    """Return the URL of a store.

    `where`: a file, or a ``sqlite:`` or ``postgresql:`` URL; None for ``$PALPATE_STORE``, else
        ``palpate-items.sqlite`` in the current folder.
    Raises `InputError` if the URL is invalid or names another kind of database.

    >>> str(store_url("monday.sqlite"))
    'sqlite:///monday.sqlite'
    >>> str(store_url("postgresql://hall3/palpate"))
    'postgresql+psycopg://hall3/palpate'
    """
    named = str(where or os.environ.get(STORE_VARIABLE) or DEFAULT_STORE)
    if "://" not in named:
        return sa.URL.create("sqlite", database=named)
    try:
        url = sa.make_url(named)
    except (sa.exc.ArgumentError, ValueError) as error:
        raise InputError(f"store {named.split('@')[-1]!r}: invalid URL ({error})") from error
    driver = url.get_backend_name()
    if driver in ("postgresql", "postgres"):
        return url.set(drivername="postgresql+psycopg")
    if driver == "sqlite":
        return url
    raise InputError(
        f"store {driver}://...: must be a file, or a URL that begins with sqlite:/// or "
        "postgresql://"
    )


def read_only_url(url: sa.URL) -> sa.URL:
    """Return the URL for reading an SQLite file, also from a read-only medium.

    SQLite creates helper files in the folder. In a read-only folder it fails unless the URL is
    marked immutable. If a helper file exists, another process may write, and the URL is returned
    unchanged.
    """
    path = Path(url.database or "")
    helper = Path(f"{path}-wal")
    if helper.exists() or os.access(path.parent, os.W_OK, effective_ids=True):
        return url
    immutable = {"mode": "ro", "immutable": "1", "uri": "true"}
    return url.set(database=f"file:{quote(str(path))}", query=immutable)


def show_url(url: sa.URL) -> str:
    """Return a store's name for messages: its file, or its URL without the password."""
    if url.get_backend_name() == "sqlite":
        return f"store {url.database or 'in memory'}"
    return f"store {url.set(drivername='postgresql').render_as_string(hide_password=True)}"


def make_engine(url: sa.URL) -> sa.Engine:
    """Return an engine with settings for concurrent processes, without connecting.

    Raises `MissingExtraError` for PostgreSQL without its driver.
    """
    if url.get_backend_name() == "sqlite":
        engine = sa.create_engine(url, connect_args={"timeout": LOCK_TIMEOUT_S})
        sa.event.listen(engine, "connect", _prepare_sqlite)
        sa.event.listen(engine, "begin", _begin_sqlite)
        return engine
    settings = f"-c lock_timeout={LOCK_TIMEOUT_S:g}s"
    if "options" in url.query:
        settings = f"{url.query['options']} {settings}"
    url = url.update_query_dict({"options": settings})
    if "connect_timeout" not in url.query:
        url = url.update_query_dict({"connect_timeout": str(_CONNECT_TIMEOUT_S)})
    with require_extra("a store on PostgreSQL", extra="postgresql", package="palpate-station"):
        from palpate_station.store.postgresql import TimeLimitedConnection

        engine = sa.create_engine(url, pool_pre_ping=True)

    def connect(dialect: object, record: object, arguments: Any, options: Any) -> Any:
        return TimeLimitedConnection.connect(*arguments, **options)

    sa.event.listen(engine, "do_connect", connect)
    return engine


@contextmanager
def translate_errors(where: str) -> Iterator[None]:
    """Convert database errors into palpate errors with a one-line message.

    Raises `StoreAwayError` if the database is temporarily not available; `StoreError` if it is
    unusable; `InputError` if a record refers to a record that is not stored.
    """
    try:
        yield
    except sa.exc.IntegrityError as error:
        raise InputError(
            f"{where}: the record refers to an item, grasp or calibration that is not stored; add "
            "the item, grasp or calibration first"
        ) from error
    except sa.exc.DBAPIError as error:
        raise _explain_error(error, where=where) from error
    except sa.exc.TimeoutError as error:
        raise StoreAwayError(f"{where}: all connections are in use; try again") from error
    except UnicodeDecodeError as error:  # raised by the driver for a damaged schema
        raise damage_error(where) from error


def damage_error(where: str) -> StoreError:
    """Return the error for a store with invalid content."""
    return StoreError(f"{where}: {_SQLITE_FAULTS['SQLITE_CORRUPT'][1]}")


def _explain_error(error: sa.exc.DBAPIError, *, where: str) -> StoreError:
    origin = error.orig
    if isinstance(origin, sqlite3.Error):
        code, known = getattr(origin, "sqlite_errorname", None), _SQLITE_FAULTS
    else:
        code, known = getattr(origin, "sqlstate", None), _POSTGRESQL_FAULTS
    for start, (kind, text) in known.items():
        if code is not None and code.startswith(start):
            return kind(f"{where}: {text.format(wait=LOCK_TIMEOUT_S)}")
    message = " ".join(str(origin).split())
    # Without a connection to the server there is no SQLSTATE.
    if code is None and isinstance(error, sa.exc.OperationalError):
        return _explain_unreachable(message, where=where)
    return StoreError(f"{where}: {message}")


def _explain_unreachable(message: str, *, where: str) -> StoreError:
    """Return the error for a server that refused the connection or did not answer."""
    for words, state in (
        ("authentication failed", "28"),
        ("no password supplied", "28"),
        ('role "', "28"),
        ("does not exist", "3D000"),
    ):
        if words in message:
            return StoreError(f"{where}: {_POSTGRESQL_FAULTS[state][1]}")
    return StoreAwayError(f"{where}: no answer; check the server and the network ({message})")


def _prepare_sqlite(connection: Any, record: object) -> None:
    del record
    # Disable the driver's implicit transactions; `_begin_sqlite` begins them.
    connection.isolation_level = None
    # WAL allows readers during a write; FULL protects committed records from a power failure.
    _execute_unlocked(connection, "PRAGMA journal_mode = WAL")
    for pragma in ("synchronous = FULL", "foreign_keys = ON"):
        connection.execute(f"PRAGMA {pragma}")


def _execute_unlocked(connection: Any, statement: str) -> None:
    """Execute a statement for whose lock SQLite itself does not wait."""
    until_s = time.monotonic() + LOCK_TIMEOUT_S
    while True:
        try:
            connection.execute(statement)
            return
        except sqlite3.OperationalError as error:
            if "locked" not in str(error) or time.monotonic() > until_s:
                raise
        time.sleep(_LOCK_RETRY_S)


def _begin_sqlite(connection: sa.Connection) -> None:
    # A writer locks immediately, because an upgrade from a read transaction can fail.
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
