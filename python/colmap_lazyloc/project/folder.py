"""The folder of a project: its files, links to photos and masks, and which steps are done."""

import dataclasses
import hashlib
import json
import pathlib
import re
import shutil
from collections.abc import Iterable, Mapping
from typing import Any

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.pose_formats.posed_images import UNREADABLE_SUFFIXES, list_images

DATABASE, QUERY = "database", "query"  # folders of the names of images


@dataclasses.dataclass(frozen=True)
class Folder:
    """The paths of a project. Names of images are relative to `images`, so that the database serves other programs."""

    path: pathlib.Path

    images = property(lambda self: self.path / "images")
    masks = property(lambda self: self.path / "masks")
    frames = property(lambda self: self.path / "frames")
    faces = property(lambda self: self.path / "faces")
    database = property(lambda self: self.path / "database.db")
    model = property(lambda self: self.path / "model")
    sparse = property(lambda self: self.path / "sparse")
    index = property(lambda self: self.path / "database.index")
    vocab_tree = property(lambda self: self.path / "vocab_tree.bin")
    lists = property(lambda self: self.path / "lists")
    localized = property(lambda self: self.path / "localized")
    report = property(lambda self: self.path / "report.html")
    log = property(lambda self: self.path / "log.txt")
    steps = property(lambda self: self.path / "steps.json")

    def write_list(self, name: str, lines: Iterable[str]) -> pathlib.Path:
        """Writes a text file for a command of COLMAP."""
        self.lists.mkdir(parents=True, exist_ok=True)
        path: pathlib.Path = self.lists / f"{name}.txt"
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        return path


def link_photos(folder: Folder, role: str, source: pathlib.Path, masks: pathlib.Path | None) -> dict[str, str]:
    """Links the photos of a folder, or a single one, and their masks into the project; returns the names of the images
    by those of the photos. Blanks become underscores, because COLMAP's lists of pairs cannot hold them."""
    names = [source.name] if source.is_file() else list_images(source)
    root = source.parent if source.is_file() else source
    unreadable = [] if source.is_file() else list_images(source, UNREADABLE_SUFFIXES)
    hint = f"COLMAP cannot read {unreadable[0]}: convert photos of this kind to JPEG" if unreadable else ""
    if not names:
        raise InputError(f"{source}: {hint or 'holds no image file'}")
    if hint:
        logger.warning("%s: %s (%d left out)", source, hint, len(unreadable))
    linked = {name: role + "/" + re.sub(r"\s", "_", name) for name in names}
    if len(set(linked.values())) < len(linked):
        raise InputError(f"{source}: two names of photos differ only in blanks and underscores")
    _replace_links(folder.images, role, {linked[name]: root / name for name in names})
    mask_root = None if masks is None else next((path for path in (masks / role, masks) if path.is_dir()), masks)
    if mask_root is not None:
        found = {f"{linked[name]}.png": mask_root / f"{name}.png" for name in names}
        _replace_links(folder.masks, role, {name: path for name, path in found.items() if path.is_file()})
    return linked


def _replace_links(folder: pathlib.Path, role: str, targets: Mapping[str, pathlib.Path]) -> None:
    shutil.rmtree(folder / role, ignore_errors=True)
    (folder / role).mkdir(parents=True)
    for name, target in targets.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(target.resolve())


def fingerprint(*values: Any, files: Iterable[pathlib.Path] = ()) -> str:
    """Returns a hash of values, and of the sizes and times of files."""
    states = [(str(path), stat.st_size, stat.st_mtime_ns) for path in files for stat in [path.stat()]]
    return hashlib.sha256(json.dumps([values, states], default=str).encode()).hexdigest()[:16]


class Steps:
    """Remembers in a file which steps are done, and with what."""

    def __init__(self, path: pathlib.Path):
        self._path = path
        try:
            self._done: dict[str, str] = json.loads(path.read_text()) if path.exists() else {}
        except (OSError, ValueError):
            raise InputError(f"{path}: is damaged; delete it to do all steps again") from None

    def is_done(self, name: str, key: str) -> bool:
        """True if the step was finished with this fingerprint."""
        return self._done.get(name) == key

    def differs(self, name: str, key: str) -> bool:
        """True if the step was begun or finished with another fingerprint."""
        return self._done.get(name, key).removesuffix(" begun") != key

    def begin(self, name: str, key: str) -> None:
        self._write(name, f"{key} begun")

    def finish(self, name: str, key: str) -> None:
        self._write(name, key)

    def _write(self, name: str, text: str) -> None:
        self._done[name] = text
        staged = self._path.with_suffix(".tmp")
        staged.write_text(json.dumps(self._done, indent=2) + "\n")
        staged.replace(self._path)
