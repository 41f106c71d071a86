"""Tables of the store, and their migration.

Schema 2 added the outbox to the local SQLite file, which a PostgreSQL server does not have.
Schema 3 (on a server, 2) added the station of a grasp. Schema 4 (on a server, 3) gave the force of
the firmness a column; before, it was a measurement without width. Schema 5 (on a server, 4) allows
a bound: a measurement without value, or without a limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

from palpate.errors import StoreError
from palpate.measurement import BOUNDS

#: Newest schema version of each kind of database.
NEWEST: Mapping[str, int] = {"sqlite": 5, "postgresql": 4}
#: Key of the PostgreSQL advisory lock for migrations.
_LOCK = 0x70616C70


class UtcTime(sa.types.TypeDecorator[datetime]):
    """A UTC time: timestamp with time zone, or sortable ISO 8601 text in SQLite."""

    impl = sa.TIMESTAMP(timezone=True)
    cache_ok = True

    def load_dialect_impl(self, dialect: sa.Dialect) -> sa.types.TypeEngine[Any]:
        """Return the column type for a database."""
        own: sa.types.TypeEngine[Any] = (
            sa.TEXT() if dialect.name == "sqlite" else sa.TIMESTAMP(timezone=True)
        )
        return dialect.type_descriptor(own)

    def process_bind_param(self, value: datetime | None, dialect: sa.Dialect) -> Any:
        """Convert a time for storage."""
        if value is None or dialect.name != "sqlite":
            return value
        text = value.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds")
        return f"{text}Z"

    def process_result_value(self, value: Any, dialect: sa.Dialect) -> datetime | None:
        """Return a stored time in UTC."""
        if value is None:
            return None
        moment = datetime.fromisoformat(value) if isinstance(value, str) else value
        return moment.astimezone(UTC)


METADATA = sa.MetaData()
#: SQLite numbers rows automatically for a key of type INTEGER only.
_NUMBER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
_REAL = sa.DOUBLE_PRECISION[float]()

VERSIONS = sa.Table(
    "palpate_schema",
    METADATA,
    sa.Column("version", sa.Integer, primary_key=True),
    sa.Column("applied_at", UtcTime, nullable=False),
)
CALIBRATIONS = sa.Table(
    "calibrations",
    METADATA,
    sa.Column("calibration_id", sa.Text, primary_key=True),
    sa.Column("content", sa.Text, nullable=False),
)
ITEMS = sa.Table(
    "items",
    METADATA,
    sa.Column("item_id", sa.Text, primary_key=True),
    sa.Column("kind", sa.Text),
    sa.Column("batch", sa.Text),
    sa.Column("label", sa.Text),
    sa.Column("first_seen", UtcTime, nullable=False),
    sa.Index("items_by_kind", "kind", "first_seen"),
    sa.Index("items_by_batch", "batch", "first_seen"),
    sa.Index("items_by_time", "first_seen"),
)
GRASPS = sa.Table(
    "grasps",
    METADATA,
    sa.Column("number", _NUMBER, sa.Identity(), primary_key=True),
    sa.Column("grasp_id", sa.Text, nullable=False, unique=True),
    sa.Column("item_id", sa.Text, sa.ForeignKey(ITEMS.c.item_id), nullable=False),
    sa.Column("taken_at", UtcTime, nullable=False),
    sa.Column("rig", sa.Text, nullable=False),
    sa.Column("drive", sa.Text, nullable=False),
    sa.Column("origin", sa.Text, nullable=False),
    sa.Column("outcome", sa.Text, nullable=False),
    sa.Column("decision_time_s", _REAL),
    sa.Column("peak_force_n", _REAL),
    sa.Column("angle_deg", _REAL),
    sa.Column("height_mm", _REAL),
    sa.Column("temperature_c", _REAL),
    sa.Column("humidity_percent", _REAL),
    sa.Column("calibration_id", sa.Text, sa.ForeignKey(CALIBRATIONS.c.calibration_id)),
    sa.Column("recording", sa.Text),
    sa.Column("pixel_settled_percent", sa.JSON(none_as_null=True)),
    sa.Column("station", sa.Text),
    sa.Column("firmness_force_n", _REAL),
    sa.Index("grasps_by_item", "item_id", "taken_at"),
    sa.Index("grasps_by_time", "taken_at"),
)
MEASUREMENTS = sa.Table(
    "measurements",
    METADATA,
    sa.Column("grasp_number", sa.BigInteger, sa.ForeignKey(GRASPS.c.number), primary_key=True),
    sa.Column("name", sa.Text, primary_key=True),
    # Null if only a bound is known; a limit is null if it is infinite.
    sa.Column("value", _REAL),
    sa.Column("low", _REAL),
    sa.Column("high", _REAL),
    sa.Column("level", _REAL, nullable=False),
    sa.Column("status", sa.Text, nullable=False),
    sqlite_with_rowid=False,
)
#: Force of the firmness of a grasp where it is still a measurement.
OLD_FIRMNESS_FORCE_N = (
    sa.select(MEASUREMENTS.c.value)
    .where(
        MEASUREMENTS.c.grasp_number == GRASPS.c.number,
        MEASUREMENTS.c.name == GRASPS.c.firmness_force_n.name,
    )
    .scalar_subquery()
)
VERDICTS = sa.Table(
    "verdicts",
    METADATA,
    sa.Column("verdict_id", sa.Text, primary_key=True),
    sa.Column("item_id", sa.Text, sa.ForeignKey(ITEMS.c.item_id), nullable=False),
    sa.Column("grasp_id", sa.Text, sa.ForeignKey(GRASPS.c.grasp_id)),
    sa.Column("about", sa.Text, nullable=False),
    sa.Column("source", sa.Text, nullable=False),
    sa.Column("text", sa.Text, nullable=False),
    sa.Column("probability", _REAL),
    sa.Column("explanation", sa.Text, nullable=False),
    sa.Column("details", sa.JSON, nullable=False),
    sa.Column("given_at", UtcTime, nullable=False),
    sa.Index("verdicts_by_item", "item_id", "given_at"),
    sa.Index("verdicts_by_subject", "about", "source", "given_at"),
)

OUTBOX = sa.Table(
    "outbox",
    METADATA,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("receiver", sa.Text, nullable=False),
    sa.Column("kind", sa.Text, nullable=False),
    sa.Column("content", sa.Text, nullable=False),
    # Numbers are never reused, so a late acknowledgement can't remove a newer row.
    sqlite_autoincrement=True,
)


def insert(table: sa.Table, *, dialect: str) -> sqlite.Insert | postgresql.Insert:
    """Return an insert statement with support for ON CONFLICT."""
    return postgresql.insert(table) if dialect == "postgresql" else sqlite.insert(table)


def migrate(connection: sa.Connection, *, where: str) -> None:
    """Create or migrate the tables to the newest version, in the caller's transaction.

    `where`: name of the store in messages.
    Raises `StoreError` if the database was written by a newer palpate or by another program.
    """
    database = connection.dialect.name
    if database == "postgresql":
        connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_LOCK)))
    version = read_version(connection, where=where)
    if version == NEWEST[database]:
        return
    if version == 0:
        local = database == "sqlite"
        METADATA.create_all(
            connection, tables=[t for t in METADATA.sorted_tables if local or t is not OUTBOX]
        )
    else:
        if database == "sqlite" and version < 2:
            OUTBOX.create(connection)
        present = {c["name"] for c in sa.inspect(connection).get_columns(GRASPS.name)}
        if "station" not in present:
            connection.execute(sa.text("ALTER TABLE grasps ADD COLUMN station TEXT"))
        if "firmness_force_n" not in present:
            connection.execute(
                sa.text("ALTER TABLE grasps ADD COLUMN firmness_force_n DOUBLE PRECISION")
            )
            connection.execute(GRASPS.update().values(firmness_force_n=OLD_FIRMNESS_FORCE_N))
            connection.execute(
                MEASUREMENTS.delete().where(MEASUREMENTS.c.name == GRASPS.c.firmness_force_n.name)
            )
        _allow_bounds(connection)
    connection.execute(
        VERSIONS.insert().values(version=NEWEST[database], applied_at=datetime.now(UTC))
    )


def _allow_bounds(connection: sa.Connection) -> None:
    """Allow measurements without a value, and remove the value of stored bounds."""
    if connection.dialect.name == "sqlite":
        # SQLite can't remove a constraint of a column.
        connection.execute(sa.text("ALTER TABLE measurements RENAME TO old_measurements"))
        MEASUREMENTS.create(connection)
        names = ", ".join(MEASUREMENTS.c.keys())
        copy = f"INSERT INTO measurements ({names}) SELECT {names} FROM old_measurements"
        connection.execute(sa.text(copy))
        connection.execute(sa.text("DROP TABLE old_measurements"))
    else:
        for name in ("value", "low", "high"):
            connection.execute(
                sa.text(f"ALTER TABLE measurements ALTER COLUMN {name} DROP NOT NULL")
            )
    is_bound = MEASUREMENTS.c.status.in_([str(status) for status in BOUNDS])
    connection.execute(MEASUREMENTS.update().where(is_bound).values(value=None))


def read_version(connection: sa.Connection, *, where: str) -> int:
    """Return the schema version of a database; 0 for an empty database.

    Raises `StoreError` if the database was written by a newer palpate or by another program.
    """
    tables = sa.inspect(connection).get_table_names()
    if VERSIONS.name not in tables:
        if tables:
            raise StoreError(
                f"{where}: a database of another program (it has a table {sorted(tables)[0]!r}); "
                "name an empty or a new database"
            )
        return 0
    version: int = connection.scalar(sa.select(sa.func.max(VERSIONS.c.version))) or 0
    newest = NEWEST[connection.dialect.name]
    if version > newest:
        raise StoreError(
            f"{where}: written by a newer palpate (schema {version}, this one reads up to "
            f"{newest}); update palpate"
        )
    return version
