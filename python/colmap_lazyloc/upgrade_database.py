"""Upgrades a COLMAP 3 database so that COLMAP 4 can open it; by default writes an upgraded copy.

    python -m colmap_lazyloc.upgrade_database DATABASE

COLMAP 3.10 creates the table pose_priors without the column position_covariance, without which COLMAP 4 fails ("No
registered database factory succeeded") and leaves the file half migrated. This command adds the column, also to a
half-migrated database. COLMAP 4 does the rest of the migration when it opens the database. lazy_localizer reads the
databases of all versions without it.
"""

import argparse
import contextlib
import pathlib
import sqlite3
import sys
import tempfile
from collections.abc import Sequence

from colmap_lazyloc.database import connect
from colmap_lazyloc.errors import InputError, Parser, command


def incomplete_tables(connection: sqlite3.Connection) -> list[str]:
    """Returns the tables that make COLMAP 4 fail; raises InputError if this is not a COLMAP database."""
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    missing = {"cameras", "images", "keypoints", "two_view_geometries"} - tables
    if missing:
        raise InputError(f"is no COLMAP database: it has no table {min(missing)}")

    def lacks_column(table: str) -> bool:
        return "position_covariance" not in {row[1] for row in connection.execute(f"PRAGMA table_info({table})")}

    # Look for both names, because COLMAP 4 renames the table before it fails.
    return [table for table in ("pose_priors", "pose_priors_old") if table in tables and lacks_column(table)]


def upgrade(connection: sqlite3.Connection) -> None:
    for table in incomplete_tables(connection):
        connection.execute(f"ALTER TABLE {table} ADD COLUMN position_covariance BLOB")


def copy_database(source: pathlib.Path, target: pathlib.Path) -> None:
    """Copies a database, including changes that are still in its write-ahead log."""
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        unfinished = pathlib.Path(folder) / target.name
        with contextlib.closing(connect(source)) as stored, contextlib.closing(connect(unfinished, "rwc")) as copy:
            stored.backup(copy)
        unfinished.rename(target)


def run(arguments: argparse.Namespace) -> None:
    source = arguments.database_path
    if not source.is_file():
        raise InputError(f"{source}: no such file")
    target = arguments.output_path or source.with_name(source.stem + "_colmap4" + source.suffix)
    if arguments.in_place:
        target = source
    elif target.exists():
        raise InputError(f"{target}: is there already")
    try:
        with contextlib.closing(connect(source)) as connection:
            if not incomplete_tables(connection):
                print(f"{source}: COLMAP 4 can open it as it is; nothing is written")
                return
        if target != source:
            copy_database(source, target)
        with contextlib.closing(connect(target, "rw")) as connection, connection:
            upgrade(connection)
    except sqlite3.Error as error:
        raise InputError(f"{source}: {error}") from error
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    print(f"{target}: COLMAP 4 can open it now")


@command
def main(arguments: Sequence[str] | None = None) -> None:
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("database_path", type=pathlib.Path, help="database to upgrade")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--output_path", type=pathlib.Path, help="copy to write; default: NAME_colmap4.db next to NAME.db"
    )
    where.add_argument("--in_place", action="store_true", help="change the database itself instead of a copy")
    run(parser.parse_args(arguments))


if __name__ == "__main__":
    sys.exit(main())
