"""Writes files completely or not at all: next to their place, and then renames them."""

import contextlib
import os
import pathlib
import shutil
from collections.abc import Iterable, Iterator

from colmap_lazyloc.errors import InputError


def check_output(path: pathlib.Path, is_folder: bool, page_name: str = "") -> None:
    """Checks early that the output can be written, because making it may take minutes."""
    if not path.absolute().parent.is_dir():
        raise InputError(f"{path}: cannot be written: its folder does not exist")
    if not is_folder and path.is_dir():
        raise InputError(f"{path}: is a folder; name a file, or use --split")
    if is_folder and path.exists() and not (path / page_name).exists():
        raise InputError(f"{path}: would be replaced, but is no earlier report (it has no {page_name})")
    staged = _staged(path)
    try:
        staged.touch()
        staged.unlink()
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def write_file(path: pathlib.Path, pieces: Iterable[bytes]) -> int:
    """Writes a file; returns its size in bytes."""
    with replacing(path) as staged:
        with staged.open("wb") as file:
            file.writelines(pieces)
        return staged.stat().st_size


def write_folder(path: pathlib.Path, files: Iterable[tuple[str, bytes]]) -> int:
    """Writes a folder of files, in place of an earlier one; returns its size in bytes."""
    size = 0
    with replacing(path) as staged:
        for name, content in files:
            file = staged / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
            size += len(content)
    return size


@contextlib.contextmanager
def replacing(path: pathlib.Path) -> Iterator[pathlib.Path]:
    """Gives the path of what will replace `path`; removes it if there is an error."""
    staged, old = _staged(path), path.absolute().with_name(f".{path.name}.{os.getpid()}.old")
    try:
        yield staged
        try:
            if path.is_dir():
                path.rename(old)
            staged.replace(path)
        except BaseException:
            if old.exists() and not path.exists():
                old.rename(path)
            raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        for rest in (staged, old):
            _remove(rest)


def _staged(path: pathlib.Path) -> pathlib.Path:
    return path.absolute().with_name(f".{path.name}.{os.getpid()}")


def _remove(path: pathlib.Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
