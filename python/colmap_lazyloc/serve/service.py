"""What the service answers to each request."""

import asyncio
import dataclasses
import pathlib
import time
from collections.abc import Awaitable, Callable
from typing import TypeVar

from fastapi import HTTPException, Request, Response

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.geo import FILE_NAME
from colmap_lazyloc.result import Result
from colmap_lazyloc.serve import geopose
from colmap_lazyloc.serve.limits import Limits, Queue
from colmap_lazyloc.serve.map import CurrentMap
from colmap_lazyloc.serve.metrics import Metrics
from colmap_lazyloc.serve.query import Query, parse_fields
from colmap_lazyloc.serve.uploads import Upload, check_photo

PAGE = pathlib.Path(__file__).with_name("page.html")
PAGE_POLICY = (  # the page loads nothing, and asks only this service
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Service:
    """Answers requests by a localizer, as many at a time as it has threads. A photo is never written to a disk."""

    def __init__(self, current: CurrentMap, limits: Limits):
        self.current, self._limits = current, limits
        self.queue = Queue(current.map.localizer.num_threads, limits)
        paths = ("/", "/healthz", "/localize", "/metrics", "/openapi.json", "/reload", *geopose.PATHS)
        self.metrics = Metrics(paths)

    async def page(self) -> Response:
        return Response(PAGE.read_bytes(), media_type="text/html", headers={"Content-Security-Policy": PAGE_POLICY})

    async def healthz(self) -> dict[str, str]:
        return {"status": "ok"}

    async def show_metrics(self) -> Response:
        return Response(self.metrics.text(self.queue.gauges()), media_type="text/plain; version=0.0.4")

    async def reload(self) -> dict[str, str]:
        """Opens the database anew; requests that run are answered by the old one."""
        if self.current.is_reloading:
            raise self.queue.busy("the database is being reloaded")
        try:
            await self.current.reload()
        except InputError as error:
            raise HTTPException(409, f"the database before stays in use: {error}") from None
        return {"status": "ok"}

    async def localize(self, request: Request) -> Response:
        """Returns the line of results.jsonl."""
        seconds = time.monotonic()
        sessions = session = None

        async def read(upload: Upload) -> Query:
            nonlocal sessions, session
            photo, in_url, in_form = await upload.read()
            fields = parse_fields(in_url) | parse_fields(in_form)
            prior = None
            if "session" in fields:
                # With the token, so that nobody asks where the session of someone else is.
                sessions, session = self.current.sessions, (request.headers.get("Authorization"), fields.pop("session"))
                prior = sessions.prior(session, seconds) if "position" not in fields else None
            return Query(photo, fields, self.current.map.localizer, prior)

        _, result = await self._answer(request, read)
        if sessions is not None:
            sessions.add(session, seconds, result)
        return Response(result.line + "\n", media_type="application/json")

    async def localize_geopose(self, request: Request) -> Response:
        """Answers by the GeoPose Protocol."""
        localizer, origin = self.current.map.localizer, self.current.map.origin
        if origin is None:
            raise HTTPException(501, f"the model is not geographic: it has no {FILE_NAME}")
        geopose.check_version(request.headers.get("Accept", ""))

        async def read(upload: Upload) -> _GeoPoseQuery:
            body = await upload.read_body()
            parsed = await asyncio.to_thread(geopose.parse, body, origin, self._limits.max_pixels)
            return _GeoPoseQuery(parsed.photo, parsed.fields, localizer, request=parsed)

        query, result = await self._answer(request, read)
        if not result.is_localized:
            raise HTTPException(404, f"the photo is not localized: {result.status}: {result.reason}")
        text = await asyncio.to_thread(geopose.answer, query.request, result, origin)
        return Response(text, media_type="application/json")

    async def _answer(
        self, request: Request, read: Callable[[Upload], Awaitable["_QueryT"]]
    ) -> tuple["_QueryT", Result]:
        """Reads and localizes a query."""
        start = time.monotonic()
        deadline = asyncio.get_running_loop().time() + self._limits.max_seconds
        self.queue.check()
        upload = Upload(request, self.queue, self._limits.max_bytes)
        try:
            try:
                async with asyncio.timeout_at(deadline):
                    query = await read(upload)
                    await asyncio.to_thread(check_photo, query.photo, self._limits.max_pixels)
            except TimeoutError:
                raise HTTPException(408, "the photo did not arrive in time", {"Connection": "close"}) from None
            result = await self.queue.run(request, query.localize, deadline)
        except InputError as error:
            raise HTTPException(422, str(error)) from None
        finally:
            upload.release()
        if result.status == "UNREADABLE_IMAGE":
            raise HTTPException(422, "the photo is damaged: it cannot be decoded")
        self.metrics.add_result(result.status, time.monotonic() - start)
        return query, result


@dataclasses.dataclass(frozen=True)
class _GeoPoseQuery(Query):
    request: geopose.GeoPoseRequest = dataclasses.field(kw_only=True)


_QueryT = TypeVar("_QueryT", bound=Query)
