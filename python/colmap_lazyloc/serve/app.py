"""The application: routes, who is let in, and what is counted."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Sequence
from typing import Annotated, Any

from fastapi import Depends, FastAPI, HTTPException, Response
from fastapi.responses import JSONResponse
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from colmap_lazyloc import __version__
from colmap_lazyloc.serve import geopose
from colmap_lazyloc.serve.metrics import Metrics
from colmap_lazyloc.serve.openapi import describe_answers, describe_geopose, describe_localize
from colmap_lazyloc.serve.service import Service
from colmap_lazyloc.serve.tokens import Tokens

DISCONNECTED = 499  # in the metrics, as nginx has it: nobody is there to answer


def make_app(service: Service, tokens: Tokens | None) -> FastAPI:
    """Returns the application. `tokens`: who may localize, reload and see the metrics; None: everybody."""

    @contextlib.asynccontextmanager
    async def watching(_: FastAPI) -> AsyncIterator[None]:
        watch = asyncio.create_task(service.current.watch())
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
        **describe_localize(service.current.has_world_up),
    )
    for path in geopose.PATHS:
        add(
            path,
            service.localize_geopose,
            methods=["POST"],
            dependencies=closed,
            responses=describe_answers([*also, 400, 404, 408, 413, 415, 422, 501, 503, 504]),
            response_class=JSONResponse,
            **describe_geopose(),
        )
    return app


async def _disconnected(*_: Any) -> Response:
    return Response(status_code=DISCONNECTED)


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
