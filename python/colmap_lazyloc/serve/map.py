"""What the service localizes photos against, as it is now."""

import asyncio
import dataclasses
import os
import pathlib
from collections.abc import Mapping

from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.localizer import Localizer
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.results import find_run
from colmap_lazyloc.serve.sessions import Sessions

ON_DEMAND = "LazyLocalizer.Advanced.on_demand"
WATCH_SECONDS = 1.0  # between two looks at the files of the model


@dataclasses.dataclass(frozen=True)
class Map:
    """A model and its database, as they were when they were opened."""

    localizer: Localizer
    origin: GeoOrigin | None  # of the model's coordinates, if they are geographic


@dataclasses.dataclass(frozen=True)
class Source:
    """Where a map is read from: the folder of a COLMAP model or the output folder of `lazyloc run`, a database (None:
    database.db beside the model), and options of the localizer by name."""

    folder: pathlib.Path
    database: pathlib.Path | None
    settings: Mapping[str, str]

    @property
    def model(self) -> pathlib.Path:
        """Returns the folder of the model."""
        project = find_run(self.folder).project
        return self.folder if project is None else project.model

    def open(self) -> Map:
        """Opens the model and the database as they are now; raises InputError if that is impossible."""
        project, settings, model = find_run(self.folder).project, dict(self.settings), self.model
        if not model.is_dir():
            raise InputError(f"{model}: " + ("is not a folder" if model.exists() else "does not exist"))
        database = self.database or model.resolve().parent / "database.db"
        if not database.exists():
            hint = "does not exist" if self.database else "does not exist: name the database with --database_path"
            raise InputError(f"{database}: {hint}")
        if project is not None:  # made by lazyloc run, with its photos, perhaps an index, and perhaps no features yet
            settings.setdefault("image_path", str(project.images))
            if project.index.exists():
                settings.setdefault("retrieval_index_path", str(project.index))
            with DatabaseReader(database) as reader:
                settings.setdefault(ON_DEMAND, str(int(reader.num_descriptors() == 0)))
        return Map(Localizer(database, model, options=settings), GeoOrigin.read(model))

    def stamp(self) -> list[tuple[str | int, ...]]:
        """Returns what is another one after a file of the model has changed."""
        try:
            with os.scandir(self.model) as entries:
                files = [(entry.name, entry.stat()) for entry in entries]
        except OSError:  # while it is replaced
            return []
        return sorted((name, stat.st_ino, stat.st_size, stat.st_mtime_ns) for name, stat in files)


class CurrentMap:
    """The map that requests use, and the places of sessions in it. It is opened anew when its files change."""

    def __init__(self, source: Source):
        """Opens the map; raises InputError if that is impossible."""
        self._source = source
        self._stamp = source.stamp()  # of the files before they were opened
        self.map, self.sessions = source.open(), Sessions()
        self._lock = asyncio.Lock()

    @property
    def has_world_up(self) -> bool:
        """True if an option says where up is in the map."""
        return any(name.rpartition(".")[2] == "world_up" for name in self._source.settings)

    @property
    def is_reloading(self) -> bool:
        return self._lock.locked()

    async def reload(self) -> None:
        """Opens the map anew; raises InputError if that is impossible."""
        async with self._lock:
            self._stamp = await asyncio.to_thread(self._source.stamp)
            self.map, self.sessions = await asyncio.to_thread(self._source.open), Sessions()
        logger.info("the database is reloaded")

    async def watch(self) -> None:
        """Reloads when files of the model have changed, and have stayed the same from one look to the next."""
        before = self._stamp
        while True:
            await asyncio.sleep(WATCH_SECONDS)
            stamp = await asyncio.to_thread(self._source.stamp)
            if stamp != self._stamp and stamp == before:
                try:
                    await self.reload()
                except InputError as error:
                    logger.warning("the database before stays in use: %s", error)
            before = stamp
