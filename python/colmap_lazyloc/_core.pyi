from collections.abc import Sequence
from typing import Annotated

import numpy
from numpy.typing import NDArray

class Camera:
    def __init__(self, model: str, width: int, height: int, params: Sequence[float]) -> None: ...

class Model:
    def __init__(
        self,
        cameras: Sequence[Camera],
        names: Sequence[str],
        poses: Annotated[NDArray[numpy.float64], dict(shape=(None, 7), order="C", device="cpu", writable=False)],
        camera_of_image: Sequence[int],
    ) -> None: ...

class Query:
    pass

def named(name: str) -> Query: ...
def photo(
    name: str,
    path: str,
    pixels: Annotated[NDArray[numpy.uint8], dict(shape=(None, None, None), order="C", device="cpu", writable=False)]
    | None,
    camera: Camera | None,
) -> Query: ...

class Localizer:
    def __init__(self, settings: Sequence[tuple[str, str]], model: Model | None) -> None: ...
    def warnings(self) -> list[str]: ...
    def groups(self) -> list[list[str]]: ...
    def find_group(self, query_name: str) -> int: ...
    def matches(
        self,
        name: str,
        camera: Camera,
        keypoints: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), order="C", device="cpu", writable=False)],
        pairs: Sequence[
            tuple[
                str,
                Annotated[NDArray[numpy.float64], dict(shape=(None, 2), order="C", device="cpu", writable=False)]
                | None,
                Annotated[NDArray[numpy.uint32], dict(shape=(None, 2), order="C", device="cpu", writable=False)],
            ]
        ],
    ) -> Query: ...
    def localize_group(
        self, group: int
    ) -> list[
        tuple[
            str,
            str,
            Annotated[NDArray[numpy.float64], dict(shape=(None, None))],
            Annotated[NDArray[numpy.float64], dict(shape=(None, None))],
            Annotated[NDArray[numpy.int32], dict(shape=(None,))],
        ]
    ]: ...
    def localize_frame(
        self,
        queries: Sequence[Query],
        poses: Annotated[NDArray[numpy.float64], dict(shape=(None, 7), order="C", device="cpu", writable=False)],
        frame_name: str,
        has_scale: bool,
        is_trajectory: bool,
    ) -> list[
        tuple[
            str,
            str,
            Annotated[NDArray[numpy.float64], dict(shape=(None, None))],
            Annotated[NDArray[numpy.float64], dict(shape=(None, None))],
            Annotated[NDArray[numpy.int32], dict(shape=(None,))],
        ]
    ]: ...

def settings() -> list[tuple[str, str, str]]: ...
def run_lazy_localizer(arguments: Sequence[str]) -> int: ...
def run_lazy_indexer(arguments: Sequence[str]) -> int: ...
