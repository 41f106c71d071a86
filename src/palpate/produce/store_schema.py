"""The tables as this version of palpate reads and writes them; `store_migrations` makes them."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from palpate.produce.store_sql import postgresql, sa, sqlite


class UtcTime(sa.types.TypeDecorator[datetime]):
    """A moment in UTC: a timestamp with time zone, and in SQLite ISO 8601 text that sorts."""

    impl = sa.TIMESTAMP(timezone=True)
    cache_ok = True

    def load_dialect_impl(self, dialect: sa.Dialect) -> sa.types.TypeEngine[Any]:
        """Choose the column type of a database."""
        own: sa.types.TypeEngine[Any] = (
            sa.TEXT() if dialect.name == "sqlite" else sa.TIMESTAMP(timezone=True)
        )
        return dialect.type_descriptor(own)

    def process_bind_param(self, value: datetime | None, dialect: sa.Dialect) -> Any:
        """Write a moment."""
        if value is None or dialect.name != "sqlite":
            return value
        text = value.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds")
        return f"{text}Z"

    def process_result_value(self, value: Any, dialect: sa.Dialect) -> datetime | None:
        """Read a moment."""
        if value is None:
            return None
        moment = datetime.fromisoformat(value) if isinstance(value, str) else value
        return moment.astimezone(UTC)


METADATA = sa.MetaData()

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
)
GRASPS = sa.Table(
    "grasps",
    METADATA,
    sa.Column("number", sa.BigInteger, primary_key=True),
    sa.Column("grasp_id", sa.Text, nullable=False, unique=True),
    sa.Column("item_id", sa.Text, sa.ForeignKey(ITEMS.c.item_id), nullable=False),
    sa.Column("taken_at", UtcTime, nullable=False),
    sa.Column("rig", sa.Text, nullable=False),
    sa.Column("drive", sa.Text, nullable=False),
    sa.Column("origin", sa.Text, nullable=False),
    sa.Column("outcome", sa.Text, nullable=False),
    sa.Column("decision_time_s", sa.Double),
    sa.Column("peak_force_n", sa.Double),
    sa.Column("angle_deg", sa.Double),
    sa.Column("height_mm", sa.Double),
    sa.Column("temperature_c", sa.Double),
    sa.Column("humidity_percent", sa.Double),
    sa.Column("calibration_id", sa.Text, sa.ForeignKey(CALIBRATIONS.c.calibration_id)),
    sa.Column("recording", sa.Text),
    sa.Column("pixel_settled_percent", sa.JSON(none_as_null=True)),
)
MEASUREMENTS = sa.Table(
    "measurements",
    METADATA,
    sa.Column("grasp_number", sa.BigInteger, sa.ForeignKey(GRASPS.c.number), primary_key=True),
    sa.Column("name", sa.Text, primary_key=True),
    sa.Column("value", sa.Double, nullable=False),
    sa.Column("low", sa.Double, nullable=False),
    sa.Column("high", sa.Double, nullable=False),
    sa.Column("level", sa.Double, nullable=False),
    sa.Column("status", sa.Text, nullable=False),
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
    sa.Column("probability", sa.Double),
    sa.Column("explanation", sa.Text, nullable=False),
    sa.Column("details", sa.JSON, nullable=False),
    sa.Column("given_at", UtcTime, nullable=False),
)


def insert(table: sa.Table, *, dialect: str) -> sqlite.Insert | postgresql.Insert:
    """Return an insert that can say what to do where the row is there already."""
    return postgresql.insert(table) if dialect == "postgresql" else sqlite.insert(table)
