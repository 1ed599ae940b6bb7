"""Collects what a page lacks of single images, because one bad photo or record must not cost the page."""

import dataclasses
import sqlite3

from colmap_lazyloc.errors import logger

BAD_RECORD = (sqlite3.Error, ValueError, TypeError)  # what a damaged record raises where it is read


@dataclasses.dataclass(frozen=True)
class Gaps:
    """What is missing, and why, by image name."""

    photos: dict[str, str] = dataclasses.field(default_factory=dict)
    records: dict[str, str] = dataclasses.field(default_factory=dict)  # of the database

    def log(self) -> None:
        """Writes a line for each kind of gap."""
        for gaps, text in (
            (self.photos, "photos that the page lacks"),
            (self.records, "images that --database_path has not as in the run"),
        ):
            if gaps:
                name, problem = next(iter(gaps.items()))
                logger.warning("%s: %d; the first is '%s': %s", text, len(gaps), name, problem)
