"""A photo and its fields while they arrive, within the limits of a request."""

import io
from collections.abc import AsyncGenerator

import numpy as np
import PIL.Image
import python_multipart  # noqa: F401  Starlette needs it for forms, and says so only when the first one comes
from fastapi import HTTPException, Request
from starlette.formparsers import MultiPartException, MultiPartParser

from colmap_lazyloc.serve.geopose import Pixels
from colmap_lazyloc.serve.limits import Queue

FORMATS = ("JPEG", "PNG")
MAX_FIELD_BYTES, MAX_NUM_FIELDS = 4096, 8  # of a form, beside the photo

Fields = list[tuple[str, str]]  # names and texts


class Upload:
    """The body of a request. Its bytes count in the queue until `release`."""

    def __init__(self, request: Request, queue: Queue, max_bytes: int):
        self._request, self._queue, self._max_bytes = request, queue, max_bytes
        self._num_bytes = 0

    async def read(self) -> tuple[bytes, Fields, Fields]:
        """Returns the photo, and the fields of the URL and of the form."""
        in_url = self._request.query_params.multi_items()
        if self._request.headers.get("Content-Type", "").partition(";")[0].strip().lower() != "multipart/form-data":
            return await self.read_body(), in_url, []
        try:
            form = await _FormParser(
                self._request.headers,
                self._stream(),
                max_files=1,
                max_fields=MAX_NUM_FIELDS,
                max_part_size=MAX_FIELD_BYTES,
            ).parse()
        except MultiPartException as error:
            raise HTTPException(400, f"the form cannot be read: {error.message}") from None
        photo, in_form = b"", []
        for name, value in form.multi_items():
            if isinstance(value, str):
                in_form.append((name, value))
            elif name == "photo":
                photo = await value.read()
            else:
                raise HTTPException(422, f"unknown file {name!r}; the file must be 'photo'")
        return photo, in_url, in_form

    async def read_body(self) -> bytes:
        return b"".join([chunk async for chunk in self._stream()])

    def release(self) -> None:
        self._queue.release(self._num_bytes)

    async def _stream(self) -> AsyncGenerator[bytes, None]:
        declared = self._request.headers.get("Content-Length", "0")
        if declared.isdecimal() and int(declared) > self._max_bytes:
            raise self._too_large()
        async for chunk in self._request.stream():
            self._queue.receive(len(chunk))
            self._num_bytes += len(chunk)
            if self._num_bytes > self._max_bytes:
                raise self._too_large()
            yield chunk

    def _too_large(self) -> HTTPException:
        return HTTPException(413, f"the request is larger than {self._max_bytes / 1e6:g} megabytes")


class _FormParser(MultiPartParser):
    spool_max_size = 1 << 40  # keeps files in memory, whose bound is that of the request


def check_photo(photo: bytes | Pixels, max_pixels: int) -> None:
    """Reads the head of a file alone, because a small one may decode to any number of pixels."""
    if isinstance(photo, np.ndarray):
        return
    if not photo:
        raise HTTPException(400, "the photo is empty: send a JPEG or PNG file as the body or as the form's 'photo'")
    try:
        with PIL.Image.open(io.BytesIO(photo), formats=FORMATS) as image:
            width, height = image.size
    except Exception:  # damaged heads raise errors of many types
        raise HTTPException(415, "the photo is not a JPEG or PNG file") from None
    if width * height > max_pixels:
        raise HTTPException(413, f"the photo has {width} x {height} pixels, more than {max_pixels / 1e6:g} megapixels")
