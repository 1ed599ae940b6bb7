"""The HTTP server: uvicorn, with bounds for clients that connect and send nothing, or a head without end."""

import asyncio
import logging
from typing import Any

import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_SECONDS = 10  # for the head of a request, from the connection or from the answer before
MAX_NUM_CONNECTIONS = 500  # fewer than the 1024 files that a process may open


class _Protocol(H11Protocol):
    """Closes connections without a request, which uvicorn keeps for ever, and those beyond the maximum."""

    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        if len(self.connections) > MAX_NUM_CONNECTIONS:
            transport.abort()
        self._expect_request()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        if self._timer is not None:
            self._timer.cancel()

    def on_response_complete(self) -> None:
        self._expect_request()
        super().on_response_complete()

    def _expect_request(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_later(HEAD_SECONDS, self._close_without_request)

    def _close_without_request(self) -> None:
        # Of an answered request, the rest of the body may still come: a client may not do that for ever.
        if self.cycle is None or self.cycle.response_complete:
            self.transport.abort()


def make_server(app: FastAPI, max_seconds: float) -> uvicorn.Server:
    """Returns a server that ends in order after SIGTERM. `max_seconds`: what a request may take."""
    logging.getLogger("python_multipart").setLevel(logging.ERROR)  # it warns of each form that is none
    return uvicorn.Server(
        uvicorn.Config(
            app,
            http=_Protocol,
            ws="none",
            lifespan="on",
            server_header=False,
            access_log=False,  # whose lines would have the positions of users
            log_config=None,
            log_level="error",
            timeout_graceful_shutdown=int(max_seconds) + 1,
        )
    )
