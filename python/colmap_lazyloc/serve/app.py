"""The HTTP interface of a localizer: what it takes and answers, and the bounds of what clients can use."""

import asyncio
import concurrent.futures
import contextlib
import dataclasses
import functools
import hashlib
import hmac
import io
import math
import os
import pathlib
import time
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable, Mapping, Sequence
from typing import Annotated, Any, TypeVar

import numpy as np
import PIL.Image
import python_multipart  # noqa: F401  Starlette needs it for forms, and says so only when the first one comes
from fastapi import Depends, FastAPI, HTTPException, Request, Response
from fastapi.responses import JSONResponse
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from colmap_lazyloc import __version__
from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.inputs import GravityPrior, PositionPrior
from colmap_lazyloc.localizer import Localizer
from colmap_lazyloc.pose_formats.geo import FILE_NAME
from colmap_lazyloc.result import Result
from colmap_lazyloc.serve import geopose
from colmap_lazyloc.serve.map import Source
from colmap_lazyloc.serve.metrics import Metrics
from colmap_lazyloc.serve.openapi import describe_answers, describe_geopose, describe_localize
from colmap_lazyloc.serve.sessions import Sessions, agrees
from colmap_lazyloc.text_files import Path, read_entries

PAGE = pathlib.Path(__file__).with_name("page.html")
PAGE_POLICY = (  # the page loads nothing, and asks only this service
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
FORMATS = ("JPEG", "PNG")
MAX_FIELD_BYTES, MAX_NUM_FIELDS = 4096, 8  # of a form, beside the photo
MAX_SESSION_LENGTH = 64
WATCH_SECONDS = 1.0  # between two looks at the files of the model
DISCONNECTED = 499  # in the metrics, as nginx has it: nobody is there to answer


@dataclasses.dataclass(frozen=True)
class Limits:
    """What one request, and all together, may use."""

    max_bytes: int  # of a request's body
    max_pixels: int  # of a photo
    max_queue: int  # photos that wait for a localization
    max_seconds: float  # from the head of a request to its answer


class Tokens:
    """The bearer tokens that are let in."""

    def __init__(self, path: Path):
        """Reads a file with one token per line; empty lines and comments (#) are skipped."""
        entries = read_entries(path)
        if not entries:
            raise InputError(f"{path}: contains no token")
        for number, token in entries:
            if not token.isascii() or not token.isprintable() or " " in token:
                raise InputError(f"{path}, line {number}: a token must be printable ASCII without blanks")
        # Hashes have one length, so that the time of a comparison says nothing of a token.
        self._hashes = [hashlib.sha256(token.encode()).digest() for _, token in entries]

    def __contains__(self, token: str) -> bool:
        given = hashlib.sha256(token.encode()).digest()
        return any([hmac.compare_digest(given, known) for known in self._hashes])  # a list, to compare with all


class Service:
    """Answers requests by a localizer, as many at a time as it has threads.

    Bodies in memory are bounded by what running and waiting photos may have, whoever sends them, and pixels by the
    number of threads. A photo is never written to a disk.
    """

    def __init__(self, source: Source, limits: Limits):
        """Opens the map; raises InputError if that is impossible."""
        self._source, self._limits = source, limits
        self._stamp = source.stamp()  # of the files before they were opened
        self._map, self._sessions = source.open(), Sessions()
        self.num_threads = self._map.localizer.num_threads
        self._threads = concurrent.futures.ThreadPoolExecutor(self.num_threads, "lazyloc")
        self._slots = asyncio.Semaphore(self.num_threads)
        self._reloading = asyncio.Lock()
        self._num_running = self._num_waiting = self._num_bytes = 0
        self._last_seconds = 0.0  # of a localization
        paths = ("/", "/healthz", "/localize", "/metrics", "/openapi.json", "/reload", *geopose.PATHS)
        self.metrics = Metrics(paths)

    def close(self) -> None:
        """Waits for the localizations that run."""
        self._threads.shutdown()

    async def page(self) -> Response:
        return Response(PAGE.read_bytes(), media_type="text/html", headers={"Content-Security-Policy": PAGE_POLICY})

    async def healthz(self) -> dict[str, str]:
        return {"status": "ok"}

    async def show_metrics(self) -> Response:
        gauges = {
            "running": ("Localizations that run.", self._num_running),
            "queue_length": ("Photos that wait for a localization.", self._num_waiting),
            "queue_limit": ("Photos that may wait.", self._limits.max_queue),
            "received_bytes": ("Bytes of the requests in memory.", self._num_bytes),
        }
        return Response(self.metrics.text(gauges), media_type="text/plain; version=0.0.4")

    async def reload(self) -> dict[str, str]:
        """Opens the database anew; requests that run are answered by the old one."""
        if self._reloading.locked():
            raise self._busy("the database is being reloaded")
        try:
            await self._reload()
        except InputError as error:
            raise HTTPException(409, f"the database before stays in use: {error}") from None
        return {"status": "ok"}

    async def watch(self) -> None:
        """Reloads when files of the model have changed, and have stayed the same from one look to the next."""
        before = self._stamp
        while True:
            await asyncio.sleep(WATCH_SECONDS)
            stamp = await asyncio.to_thread(self._source.stamp)
            if stamp != self._stamp and stamp == before:
                try:
                    await self._reload()
                except InputError as error:
                    logger.warning("the database before stays in use: %s", error)
            before = stamp

    async def _reload(self) -> None:
        async with self._reloading:
            self._stamp = await asyncio.to_thread(self._source.stamp)
            self._map, self._sessions = await asyncio.to_thread(self._source.open), Sessions()
        logger.info("the database is reloaded")

    async def localize(self, request: Request) -> Response:
        """Returns the line of results.jsonl."""
        seconds = time.monotonic()
        sessions = session = None

        async def read(upload: _Upload) -> _Query:
            nonlocal sessions, session
            photo, texts = await upload.read()
            fields = _parse_fields(texts)
            prior = None
            if "session" in fields:
                # With the token, so that nobody asks where the session of someone else is.
                sessions, session = self._sessions, (request.headers.get("Authorization"), fields.pop("session"))
                prior = sessions.prior(session, seconds) if "position" not in fields else None
            return _Query(photo, fields, self._map.localizer, prior)

        _, result = await self._answer(request, read)
        if sessions is not None:
            sessions.add(session, seconds, result)
        return Response(result.line + "\n", media_type="application/json")

    async def localize_geopose(self, request: Request) -> Response:
        """Answers by the GeoPose Protocol."""
        localizer, origin = self._map.localizer, self._map.origin
        if origin is None:
            raise HTTPException(501, f"the model is not geographic: it has no {FILE_NAME}")
        geopose.check_version(request.headers.get("Accept", ""))

        async def read(upload: _Upload) -> _GeoPoseQuery:
            body = await upload.read_body()
            parsed = await asyncio.to_thread(geopose.parse, body, origin, self._limits.max_pixels)
            return _GeoPoseQuery(parsed.photo, parsed.fields, localizer, request=parsed)

        query, result = await self._answer(request, read)
        if not result.is_localized:
            raise HTTPException(422, f"the photo is not localized: {result.status}: {result.reason}")
        text = await asyncio.to_thread(geopose.answer, query.request, result, origin)
        return Response(text, media_type="application/json")

    async def _answer(
        self, request: Request, read: Callable[["_Upload"], Awaitable["_QueryT"]]
    ) -> tuple["_QueryT", Result]:
        """Reads and localizes a query."""
        start = time.monotonic()
        deadline = asyncio.get_running_loop().time() + self._limits.max_seconds
        self._check_queue()
        upload = _Upload(request, self)
        try:
            try:
                async with asyncio.timeout_at(deadline):
                    query = await read(upload)
                    await asyncio.to_thread(self._check_photo, query.photo)
            except TimeoutError:
                raise HTTPException(408, "the photo did not arrive in time", {"Connection": "close"}) from None
            result = await self._run(request, query, deadline)
        except InputError as error:
            raise HTTPException(422, str(error)) from None
        finally:
            self._num_bytes -= upload.num_bytes
        if result.status == "UNREADABLE_IMAGE":
            raise HTTPException(422, "the photo is damaged: it cannot be decoded")
        self.metrics.add_result(result.status, time.monotonic() - start)
        return query, result

    def receive(self, num_bytes: int) -> None:
        """Counts bytes of a body that come into memory; raises if there are too many of all requests."""
        if self._num_bytes + num_bytes > (self.num_threads + self._limits.max_queue) * self._limits.max_bytes:
            raise self._busy("too many photos are being sent")
        self._num_bytes += num_bytes

    @property
    def max_bytes(self) -> int:
        """Returns how long a body may be."""
        return self._limits.max_bytes

    def _busy(self, text: str) -> HTTPException:
        """Returns an error that asks to try again when the photos that wait now have been localized."""
        seconds = math.ceil(self._num_waiting * self._last_seconds / self.num_threads)
        return HTTPException(503, text, {"Retry-After": str(max(1, seconds))})

    def _check_queue(self) -> None:
        if self._slots.locked() and self._num_waiting >= self._limits.max_queue:
            raise self._busy("too many photos are waiting")

    def _check_photo(self, photo: bytes | geopose.Pixels) -> None:
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
        if width * height > self._limits.max_pixels:
            megapixels = self._limits.max_pixels / 1e6
            raise HTTPException(413, f"the photo has {width} x {height} pixels, more than {megapixels:g} megapixels")

    async def _run(self, request: Request, query: "_Query", deadline: float) -> Result:
        """Waits for a free thread and localizes."""
        self._check_queue()
        self._num_waiting += 1
        try:
            async with asyncio.timeout_at(deadline):
                await self._slots.acquire()
        except TimeoutError:
            raise self._busy("the photo has waited too long") from None
        finally:
            self._num_waiting -= 1
        if await request.is_disconnected():
            self._slots.release()
            raise ClientDisconnect
        self._num_running += 1
        loop, start = asyncio.get_running_loop(), time.monotonic()
        running = loop.run_in_executor(self._threads, query.localize)
        running.add_done_callback(functools.partial(self._finish, start))
        try:
            async with asyncio.timeout_at(deadline):
                return await asyncio.shield(running)  # a thread cannot be stopped, and keeps its place until it ends
        except TimeoutError:
            raise HTTPException(504, "the localization takes too long") from None

    def _finish(self, start: float, running: asyncio.Future[Result]) -> None:
        self._last_seconds = time.monotonic() - start
        self._num_running -= 1
        self._slots.release()
        if not running.cancelled():
            running.exception()  # is known, even if the request has ended before


@dataclasses.dataclass(frozen=True)
class _Query:
    """A photo, a file or pixels, with arguments of Localizer.localize_photo, and the position from its session."""

    photo: bytes | geopose.Pixels
    fields: Mapping[str, Any]
    localizer: Localizer
    prior: PositionPrior | None = None

    def localize(self) -> Result:
        if self.prior is not None:
            result = self._localize({**self.fields, "position": self.prior})
            if agrees(result):
                return result
        return self._localize(self.fields)

    def _localize(self, fields: Mapping[str, Any]) -> Result:
        if isinstance(self.photo, np.ndarray):
            return self.localizer.localize_photo(self.photo, name="photo", **fields)
        # A file in memory: nothing of the photo reaches a disk, and its EXIF is read as that of any file.
        with os.fdopen(os.memfd_create("photo"), "wb") as file:
            file.write(self.photo)
            file.flush()
            return self.localizer.localize_photo(f"/proc/self/fd/{file.fileno()}", name="photo", **fields)


@dataclasses.dataclass(frozen=True)
class _GeoPoseQuery(_Query):
    request: geopose.GeoPoseRequest = dataclasses.field(kw_only=True)


_QueryT = TypeVar("_QueryT", bound=_Query)


class _Upload:
    """A request's photo and fields while they arrive."""

    def __init__(self, request: Request, service: Service):
        self._request, self._service = request, service
        self.num_bytes = 0

    async def read(self) -> tuple[bytes, list[tuple[str, str]]]:
        """Returns the photo, and the fields of the query and of the form."""
        fields = self._request.query_params.multi_items()
        if self._request.headers.get("Content-Type", "").partition(";")[0].strip().lower() != "multipart/form-data":
            return await self.read_body(), fields
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
        photo = b""
        for name, value in form.multi_items():
            if isinstance(value, str):
                fields.append((name, value))
            elif name == "photo":
                photo = await value.read()
            else:
                raise HTTPException(422, f"unknown file {name!r}; the file must be 'photo'")
        return photo, fields

    async def read_body(self) -> bytes:
        return b"".join([chunk async for chunk in self._stream()])

    async def _stream(self) -> AsyncGenerator[bytes, None]:
        max_bytes = self._service.max_bytes
        declared = self._request.headers.get("Content-Length", "0")
        if declared.isdecimal() and int(declared) > max_bytes:
            raise HTTPException(413, _too_large(max_bytes))
        async for chunk in self._request.stream():
            self._service.receive(len(chunk))
            self.num_bytes += len(chunk)
            if self.num_bytes > max_bytes:
                raise HTTPException(413, _too_large(max_bytes))
            yield chunk


class _FormParser(MultiPartParser):
    spool_max_size = 1 << 40  # keeps files in memory, whose bound is that of the request


class _Counted:
    """Counts each request by its status."""

    def __init__(self, app: ASGIApp, metrics: Metrics):
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        status = 500  # if there will be none

        async def send_on(message: Message) -> None:
            nonlocal status
            status = message.get("status", status)
            await send(message)

        try:
            await self._app(scope, receive, send_on)
        finally:
            self._metrics.add_request(scope["path"], status)


def make_app(service: Service, tokens: Tokens | None) -> FastAPI:
    """Returns the application. `tokens`: who may localize, reload and see the metrics; None: everybody."""

    @contextlib.asynccontextmanager
    async def watching(_: FastAPI) -> AsyncIterator[None]:
        watch = asyncio.create_task(service.watch())
        yield
        watch.cancel()

    # FastAPI's pages of documentation load from elsewhere.
    app = FastAPI(title="lazyloc serve", version=__version__, docs_url=None, redoc_url=None, lifespan=watching)
    app.add_middleware(_Counted, metrics=service.metrics)
    app.add_exception_handler(ClientDisconnect, _disconnected)

    async def authorize(
        given: Annotated[HTTPAuthorizationCredentials | None, Depends(HTTPBearer(auto_error=False))],
    ) -> None:
        assert tokens is not None
        if given is None or given.credentials not in tokens:
            raise HTTPException(401, "a valid bearer token is needed", {"WWW-Authenticate": "Bearer"})

    closed: Sequence[Any] = [] if tokens is None else [Depends(authorize)]
    also = [] if tokens is None else [401]
    add = app.add_api_route
    add("/", service.page, include_in_schema=False)
    add("/healthz", service.healthz, summary="Whether the service answers")
    add(
        "/metrics",
        service.show_metrics,
        dependencies=closed,
        summary="Requests, seconds and queue, for Prometheus",
        responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, **describe_answers(also)},
        response_class=Response,
    )
    add(
        "/reload",
        service.reload,
        methods=["POST"],
        dependencies=closed,
        summary="Opens the database anew",
        responses=describe_answers([*also, 409, 503]),
    )
    add(
        "/localize",
        service.localize,
        methods=["POST"],
        dependencies=closed,
        responses=describe_answers([*also, 400, 408, 413, 415, 422, 503, 504]),
        response_class=JSONResponse,
        **describe_localize(),
    )
    for path in geopose.PATHS:
        add(
            path,
            service.localize_geopose,
            methods=["POST"],
            dependencies=closed,
            responses=describe_answers([*also, 400, 408, 413, 415, 422, 501, 503, 504]),
            response_class=JSONResponse,
            **describe_geopose(),
        )
    return app


async def _disconnected(*_: Any) -> Response:
    return Response(status_code=DISCONNECTED)


def _parse_fields(fields: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Returns the arguments of Localizer.localize_photo."""
    parsers: dict[str, Callable[[list[str]], Any]] = {
        "camera": " ".join,
        "position": _parse_position,
        "gravity": _parse_gravity,
        "session": _parse_session,
    }
    parsed: dict[str, Any] = {}
    for name, text in fields:
        if name not in parsers:
            raise InputError(f"unknown field {name!r}; known are {', '.join(parsers)}")
        if name in parsed:
            raise InputError(f"{name} is given twice")
        parsed[name] = parsers[name](text.replace(",", " ").split())
    return parsed


def _parse_position(words: list[str]) -> PositionPrior:
    numbers = _parse_numbers("position", words, (4, 6, 9))
    uncertainty: Any = numbers[3:]
    if len(numbers) == 9:
        upper = np.zeros((3, 3))
        upper[np.triu_indices(3)] = uncertainty
        uncertainty = upper + np.triu(upper, 1).T
    return numbers[:3], uncertainty


def _parse_gravity(words: list[str]) -> GravityPrior:
    *direction, stddev_deg = _parse_numbers("gravity", words, (4,))
    return direction, stddev_deg


def _parse_session(words: list[str]) -> str:
    session = " ".join(words)
    if not 0 < len(session) <= MAX_SESSION_LENGTH or not session.isprintable():
        raise InputError(f"session: must be a name of at most {MAX_SESSION_LENGTH} characters")
    return session


def _parse_numbers(name: str, words: list[str], counts: Sequence[int]) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        raise InputError(f"{name}: must be {' or '.join(map(str, counts))} numbers")
    return numbers


def _too_large(max_bytes: int) -> str:
    return f"the request is larger than {max_bytes / 1e6:g} megabytes"
