"""The results in a project's folder: the newest at its top, those of earlier runs in `earlier/N`.

The results of a run are `localized/`, `epoch/` (with --epoch), `report.html` and `run.json`, which says what they were
made of. If a run needs other results, these files move to the folder with the next number. If it needs results that are
there already, these move back. Meanwhile there is a folder `earlier/moving`, or a link `earlier/returning` to the
folder that they come from, so that the next run knows that a move was interrupted, and completes it before it writes
anything.
"""

import contextlib
import dataclasses
import html
import json
import pathlib
from collections.abc import Mapping
from typing import Any

from colmap_lazyloc.errors import logger
from colmap_lazyloc.project.folder import EARLIER, EPOCH, LOCALIZED, REPORT, RUN, Folder, remove
from colmap_lazyloc.report.page import set_links
from colmap_lazyloc.results import RESULTS

FILES = (LOCALIZED, EPOCH, REPORT, RUN)
MOVING, RETURNING = "moving", "returning"
RECORDS = "unfinished/records.bin"  # of an interrupted run of lazy_localizer


@dataclasses.dataclass(frozen=True)
class Earlier:
    """The results of an earlier run, finished or not."""

    folder: pathlib.Path
    queries: str  # as they were given


class KeptResults:
    """Keeps the results of earlier runs, by a key: a hash of everything that they follow from."""

    def __init__(self, folder: Folder):
        """Completes what an interrupted run has begun to move."""
        self._folder, self._path = folder, folder.path / EARLIER
        if (self._path / MOVING).exists():
            self._move_away()
        if (self._path / RETURNING).is_symlink():
            self._move_back()

    def earlier(self) -> list[Earlier]:
        """Returns the results of earlier runs, the oldest first."""
        return [Earlier(folder, _read(folder).get("queries", "?")) for folder in self._numbered()]

    def begin(self, key: str, inputs: str, queries: str, command: str) -> bool:
        """Returns False if the results of this key are at the top. Else makes place for them, and returns True.

        An unfinished run of this key stays, so that it goes on, if the `inputs` are the same: a hash of files that may
        differ although the key is the same. `queries`, `command`: what the user has given.
        """
        top = self._folder.path
        if _read(top).get("key") != key:
            self._put_away()
            found = [folder for folder in self._numbered() if _read(folder).get("key") == key]
            if found:
                logger.info("back from %s: the results of --queries %s", found[-1], queries)
                (self._path / RETURNING).symlink_to(found[-1].name)
                self._move_back()
        run = _read(top)
        if run.get("key") == key and run.get("finished") and (self._folder.localized / RESULTS).exists():
            return False
        if run.get("key") != key or run.get("inputs") != inputs:
            remove(self._folder.localized)
            remove(self._folder.epoch)
        _write(top, {"key": key, "inputs": inputs, "finished": False, "queries": queries, "command": command})
        return True

    def finish(self) -> None:
        """Notes that the results at the top are complete."""
        _write(self._folder.path, {**_read(self._folder.path), "finished": True})

    def note_report(self, settings: Mapping[str, str]) -> None:
        """Notes options of the report for `report_settings`."""
        _write(self._folder.path, {**_read(self._folder.path), "report": settings})

    def link(self) -> None:
        """Links the page at the top with those of earlier runs."""
        links = [
            f'<a href="{EARLIER}/{earlier.folder.name}/{REPORT}">{html.escape(earlier.queries)}</a> ({EARLIER}/'
            f"{earlier.folder.name})"
            for earlier in reversed(self.earlier())
            if (earlier.folder / REPORT).exists()
        ]
        if links and self._folder.report.exists():
            set_links(self._folder.report, f"Results of earlier runs: {', '.join(links)}")

    def _numbered(self) -> list[pathlib.Path]:
        found = [path for path in self._path.glob("*") if path.name.isdecimal()]
        return sorted(found, key=lambda path: int(path.name))

    def _put_away(self) -> None:
        """Moves the results at the top to a folder of their own, if anything was computed."""
        localized, queries = self._folder.localized, _read(self._folder.path).get("queries")
        records = localized / RECORDS
        if not (localized / RESULTS).exists() and not (records.exists() and records.stat().st_size > 0):
            for name in FILES:
                remove(self._folder.path / name)
            return
        (self._path / MOVING).mkdir(parents=True)
        place = self._move_away()
        logger.info("now in %s: the results of %s", place, f"--queries {queries}" if queries else "an earlier run")

    def _move_away(self) -> pathlib.Path:
        staged = self._path / MOVING
        self._move(self._folder.path, staged)
        if (staged / REPORT).exists():
            newest = f"../../{REPORT}"
            set_links(
                staged / REPORT, f'These are results of an earlier run: <a href="{newest}">the newest results</a>'
            )
        place = self._path / str(max((int(path.name) for path in self._numbered()), default=0) + 1)
        staged.rename(place)
        return place

    def _move_back(self) -> None:
        source = (self._path / RETURNING).resolve()
        self._move(source, self._folder.path)
        (self._path / RETURNING).unlink()
        with contextlib.suppress(OSError):  # it has files of the user, which stay
            source.rmdir()

    def _move(self, source: pathlib.Path, target: pathlib.Path) -> None:
        """Moves what is there; the record of the run goes last, because it says what the other files are."""
        for name in FILES:
            if (source / name).exists():
                (source / name).replace(target / name)


def report_settings(folder: Folder) -> dict[str, str]:
    """Returns options of the report of the newest results: `unit` and `crs`, as far as the run was given them."""
    settings: dict[str, str] = _read(folder.path).get("report", {})
    return settings


def _read(folder: pathlib.Path) -> dict[str, Any]:
    """Returns what results were made of; empty if it is not known."""
    try:
        content = json.loads((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _write(folder: pathlib.Path, content: Mapping[str, Any]) -> None:
    staged = (folder / RUN).with_suffix(".tmp")
    staged.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    staged.replace(folder / RUN)
