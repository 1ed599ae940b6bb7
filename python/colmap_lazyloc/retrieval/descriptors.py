"""Reads global descriptors of images in blocks: hloc's HDF5 files, or a .npy file with a list of names."""

import dataclasses
import pathlib
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.text_files import Path, read_entries

DATASET_NAME = "global_descriptor"
Value = TypeVar("Value")
CHUNK_BYTES = 1 << 25  # memory for descriptors in double precision


class HdfFile:
    """hloc's file: one group per image, which has the descriptor as its dataset `global_descriptor`."""

    def __init__(self, path: pathlib.Path):
        import h5py

        self.path = path
        self._h5py = h5py
        try:
            self._file = h5py.File(path, "r")
        except OSError:
            reason = "is not an HDF5 file, or is damaged" if path.is_file() else "cannot be read: no such file"
            raise InputError(f"{path}: {reason}") from None
        self._dtype: Any = None

    def list_names(self) -> list[str]:
        """Returns the names of all images that have a descriptor, sorted."""
        names: list[str] = []
        suffix = f"/{DATASET_NAME}"

        def visit(link: bytes) -> None:
            name = link.decode(errors="backslashreplace")
            if name.endswith(suffix):
                names.append(name.removesuffix(suffix))

        root = self._h5py.h5g.open(self._file.id, b"/")
        self._run(lambda: root.links.visit(visit))
        return sorted(names)

    def read(self, names: list[str]) -> Array:
        """Reads the descriptors of the images as rows, float16 or float32 as in the file."""
        return self._run(lambda: self._read(names))

    def _read(self, names: list[str]) -> Array:
        rows = None
        for i, name in enumerate(names):
            dataset = self._open(name)
            shape = dataset.shape
            if len(shape) != 1 or shape[0] == 0:
                raise InputError(f"{self.path}: descriptor of image {name} has the shape {shape}, and not (n,)")
            if rows is None:
                self._dtype = self._dtype or self._row_type(dataset.dtype, name)
                rows = np.empty((len(names), shape[0]), self._dtype)
            if shape[0] != rows.shape[1]:
                _raise_dimension(self.path, name, shape[0], rows.shape[1])
            if self._row_type(dataset.dtype, name).itemsize > self._dtype.itemsize:
                raise InputError(
                    f"{self.path}: descriptor of image {name} is {dataset.dtype}, others are {self._dtype}"
                )
            dataset.read(self._h5py.h5s.ALL, self._h5py.h5s.ALL, rows[i])
        return np.empty((0, 0), np.float32) if rows is None else rows

    def _open(self, name: str) -> Any:
        try:
            # h5py's interface to single objects takes a third of the time of its mapping interface.
            return self._h5py.h5d.open(self._file.id, f"{name}/{DATASET_NAME}".encode())
        except (KeyError, ValueError, TypeError):
            raise InputError(f"{self.path}: has no dataset {DATASET_NAME} of image {name}") from None

    def _row_type(self, dtype: np.dtype[Any], name: str) -> np.dtype[Any]:
        if dtype.kind != "f":
            raise InputError(f"{self.path}: descriptor of image {name} is {dtype}, and not a floating-point number")
        return np.dtype(np.float16 if dtype.itemsize == 2 else np.float32)

    def _run(self, function: Callable[[], Value]) -> Value:
        try:
            return function()
        except (OSError, RuntimeError) as error:
            raise InputError(f"{self.path}: is damaged: {str(error).splitlines()[0]}") from None


class NpyFile:
    """A matrix with one descriptor per row in `name.npy`, whose images are listed in `name.txt`."""

    def __init__(self, path: pathlib.Path):
        self.path = path
        rows = self._map()
        if rows.ndim != 2 or rows.dtype not in (np.float16, np.float32):
            raise InputError(
                f"{path}: has the shape {rows.shape} and type {rows.dtype}, and not n x d of float16 or 32"
            )
        list_path = path.with_suffix(".txt")
        self._row_of_name = read_name_list(list_path)
        if len(self._row_of_name) != len(rows):
            raise InputError(f"{list_path}: lists {len(self._row_of_name)} images, but {path} has {len(rows)} rows")

    def list_names(self) -> list[str]:
        """Returns the names of all images, sorted by their rows, because consecutive rows are read fastest."""
        return list(self._row_of_name)

    def read(self, names: list[str]) -> Array:
        """Reads the descriptors of the images as rows."""
        try:
            rows = [self._row_of_name[name] for name in names]
        except KeyError as error:
            raise InputError(f"{self.path}: has no image {error.args[0]}") from None
        # Map the file anew each time, because mapped pages count as memory of the process until they are unmapped.
        return np.array(self._map()[rows[0] : rows[-1] + 1] if _is_run(rows) else self._map()[rows])

    def _map(self) -> Array:
        try:
            rows: Array = np.load(self.path, mmap_mode="r", allow_pickle=False)
            return rows
        except (ValueError, EOFError) as error:
            raise InputError(f"{self.path}: is not a .npy file, or is truncated: {error}") from None
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror}") from None


@dataclasses.dataclass
class Block:
    """The descriptors of some images."""

    rows: Array  # as in the file, n x dimension
    norms: Array  # float64
    units: Array  # the rows divided by their norms, float32


@dataclasses.dataclass
class DescriptorSet:
    """The descriptors of a list of images in one file, read in blocks."""

    file: HdfFile | NpyFile
    names: list[str]
    dimension: int
    itemsize: int

    def read(self, begin: int, end: int) -> Block:
        """Returns the descriptors of names[begin:end]; throws InputError for one that cannot be used."""
        names = self.names[begin:end]
        rows = self.file.read(names)
        if rows.shape[1] != self.dimension:
            _raise_dimension(self.file.path, names[0], rows.shape[1], self.dimension)
        norms, units = np.empty(len(rows)), np.empty(rows.shape, np.float32)
        step = max(1, CHUNK_BYTES // (16 * self.dimension))
        for first in range(0, len(rows), step):
            chunk = rows[first : first + step].astype(np.float64)
            chunk_norms = np.sqrt((chunk * chunk).sum(axis=1))
            for i in np.flatnonzero(~np.isfinite(chunk_norms) | (chunk_norms == 0)):
                problem = "is zero" if chunk_norms[i] == 0 else "holds values that are not finite"
                raise InputError(f"{self.file.path}: descriptor of image {names[first + i]} {problem}")
            norms[first : first + step] = chunk_norms
            units[first : first + step] = chunk / chunk_norms[:, None]
        return Block(rows, norms, units)


def open_file(path: pathlib.Path) -> HdfFile | NpyFile:
    """Opens a file of global descriptors; throws InputError if it is none."""
    return NpyFile(path) if path.suffix == ".npy" else HdfFile(path)


def describe_set(file: HdfFile | NpyFile, names: list[str]) -> DescriptorSet:
    """Makes the set of these images; reads the first descriptor, for its size."""
    first = file.read(names[:1])
    return DescriptorSet(file, names, first.shape[1], first.dtype.itemsize)


def read_name_list(path: Path) -> dict[str, int]:
    """Reads one image name per line; returns their places in the file."""
    places: dict[str, int] = {}
    for line_number, name in read_entries(path):
        if name in places:
            raise InputError(f"{path}:{line_number}: image '{name}' is listed twice")
        places[name] = len(places)
    if not places:
        raise InputError(f"{path}: lists no image")
    return places


def _is_run(rows: list[int]) -> bool:
    return rows == list(range(rows[0], rows[0] + len(rows))) if rows else False


def _raise_dimension(path: Path, name: str, dimension: int, expected: int) -> None:
    raise InputError(f"{path}: descriptor of image {name} has {dimension} elements, others have {expected}")
