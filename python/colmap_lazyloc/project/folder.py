"""The folder of a project: its files, and which steps are done, with what."""

import dataclasses
import hashlib
import json
import pathlib
import shutil
from collections.abc import Iterable
from typing import Any

from colmap_lazyloc.errors import InputError

DATABASE, QUERY = "database", "query"  # folders of the names of images
SQLITE = (
    "",
    "-wal",
    "-shm",
    "-journal",
)  # endings of a database's files: a journal would be played back into a new one
# The files of each step. The first one is there when the step is done.
FILES = {
    f"{DATABASE} frames": (f"frames/{DATABASE}",),
    f"{QUERY} frames": (f"frames/{QUERY}",),
    f"{DATABASE} faces": (f"faces/{DATABASE}",),
    f"{QUERY} faces": (f"faces/{QUERY}",),
    "index": ("database.index",),
    "features": (
        *(f"database.db{end}" for end in SQLITE),
        "vocab_tree.bin",
        *(f"database.index{end}" for end in ("", ".aliked", ".coarse", ".features")),
    ),
    "complete": (),
    "check": (),
    "matches": (),
    "sparse": ("sparse",),
    "model": ("model",),
    "queries": tuple(f"queries.db{end}" for end in SQLITE),
}
CHAIN = ("features", "matches", "sparse", "model", "queries")  # steps that each work on what those before have made
RECORD = "steps.json"  # of the steps that are done
LOCALIZED, EPOCH, REPORT, RUN, EARLIER = (
    "localized",
    "epoch",
    "report.html",
    "run.json",
    "earlier",
)  # results, which kept.py keeps
STAGED = "staged"  # what a step makes before it replaces what an earlier run has made
MATCHES = "matches.db"  # features and matches of the photos, in the folder of an epoch
ALIGNMENT = "alignment.txt"  # beside a model of the mapper: where its metres come from, and what is inaccurate
WITHOUT_POSES = "without_poses.txt"  # beside a model of the mapper: the photos of which it found no pose, one a line
ARBITRARY_AXES = "arbitrary_axes.txt"  # beside a model none of whose axes is known to point up; lazy_localizer reads it
# Of no step; "converted" and the results are kept, the others are written anew.
OTHER_FILES = ("converted", "images", "masks", "lists", STAGED, LOCALIZED, EPOCH, REPORT, RUN, EARLIER)


@dataclasses.dataclass(frozen=True)
class Folder:
    """The paths of a project. Names of images are relative to `images`, so that the database serves other programs."""

    path: pathlib.Path

    images = property(lambda self: self.path / "images")
    converted = property(lambda self: self.path / "converted")
    masks = property(lambda self: self.path / "masks")
    frames = property(lambda self: self.path / "frames")
    faces = property(lambda self: self.path / "faces")
    database = property(lambda self: self.path / "database.db")
    query_database = property(lambda self: self.path / "queries.db")  # with the queries, for masks and for sequences
    model = property(lambda self: self.path / "model")
    sparse = property(lambda self: self.path / "sparse")
    index = property(lambda self: self.path / "database.index")
    vocab_tree = property(lambda self: self.path / "vocab_tree.bin")
    lists = property(lambda self: self.path / "lists")
    localized = property(lambda self: self.path / LOCALIZED)
    epoch = property(lambda self: self.path / EPOCH)
    report = property(lambda self: self.path / REPORT)
    staged = property(lambda self: Folder(self.path / STAGED))
    log = property(lambda self: self.path / "log.txt")
    steps = property(lambda self: self.path / RECORD)

    @property
    def reserved(self) -> list[pathlib.Path]:
        """The files and folders that a run replaces, so that they must hold nothing else."""
        names = {name.partition("/")[0] for names in FILES.values() for name in names}
        return [self.path / name for name in sorted(names.union(OTHER_FILES))]

    def write_list(self, name: str, lines: Iterable[str]) -> pathlib.Path:
        """Writes a text file for a command of COLMAP."""
        self.lists.mkdir(parents=True, exist_ok=True)
        path: pathlib.Path = self.lists / f"{name}.txt"
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        return path


def fingerprint(*values: Any) -> str:
    """Returns a hash of values."""
    return hashlib.sha256(json.dumps(values, default=str).encode()).hexdigest()[:32]


def content(path: pathlib.Path) -> str:
    """Returns a hash of what a file holds, or a folder, and of nothing else; if it cannot be read, the reason."""
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
        return fingerprint([(str(file.relative_to(path)), content(file)) for file in files])
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return str(error.strerror)


class Steps:
    """Remembers which steps are done, each with a key: a hash of everything that its output follows from.

    A step with another key is done anew, from scratch. Before it begins, it is forgotten with all steps of the chain
    after it: first in the record, then on the disk. So nothing is left that was made of other input, and nothing
    unfinished counts as done, whenever a run is interrupted.
    """

    def __init__(self, folder: Folder, version: str):
        """`version`: that of the programs, which is part of every key."""
        self._folder, self._version = folder, version
        if not folder.steps.exists():
            foreign = [path for path in folder.reserved if path.exists()]
            if foreign:
                raise InputError(f"--output {folder.path}: {foreign[0].name} is in it, not made by `lazyloc run`")
        try:
            record = json.loads(folder.steps.read_text()) if folder.steps.exists() else {}
        except (OSError, ValueError):
            record = None
        self._keys: dict[str, str] = record if isinstance(record, dict) else {}
        self._write()

    def begin(self, name: str, key: str, resumes: bool = False) -> bool:
        """Returns False if the step is done with this key. Else forgets it and what follows, and returns True.

        `resumes`: keeps what the step has made if it was begun with this key and not finished.
        """
        if self.is_done(name, key):
            return False
        key = self._version + key
        is_begun = resumes and self._keys.get(name) == f"{key} begun"
        following = CHAIN[CHAIN.index(name) + 1 :] if name in CHAIN else ()
        self.forget(*following, *([] if is_begun else [name]))
        self._keys[name] = f"{key} begun"
        self._write()
        return True

    def is_done(self, name: str, key: str) -> bool:
        """True if the step is done with this key."""
        are_there = all((self._folder.path / file).exists() for file in FILES[name][:1])
        return are_there and self._keys.get(name) == self._version + key

    def keys(self, *names: str) -> list[str | None]:
        """Returns the keys of steps, None for those that have not begun."""
        return [self._keys.get(name) for name in names]

    def is_begun(self, name: str) -> bool:
        """True if the step is done, or was interrupted."""
        return name in self._keys

    def finish(self, name: str, key: str) -> None:
        """Notes that the step is done."""
        self._keys[name] = self._version + key
        self._write()

    def forget(self, *names: str) -> None:
        """Removes the files of steps, and their keys before: a step without a key counts as not done."""
        for name in names:
            self._keys.pop(name, None)
        self._write()
        for name in names:
            # The first file goes last, because journals without their database do no harm.
            for file in reversed(FILES[name]):
                remove(self._folder.path / file)

    def forget_all(self) -> None:
        """Removes all that earlier runs have left."""
        self.forget(*FILES)
        for name in OTHER_FILES:
            remove(self._folder.path / name)
        remove(self._folder.log)

    def _write(self) -> None:
        staged = self._folder.steps.with_suffix(".tmp")
        staged.write_text(json.dumps(self._keys, indent=2) + "\n")
        staged.replace(self._folder.steps)


def remove(path: pathlib.Path) -> None:
    """Removes a file, a link, or a folder with what it holds, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
