"""Runs an HTTP service that localizes photos: POST /localize returns the pose as JSON.

    lazyloc serve localization/model

MODEL is the folder of a COLMAP model, or the output folder of `lazyloc run`. GET / returns a page for phones and
browsers, and GET /openapi.json a description of the interface. Without --host, only programs on this machine can reach
the service. You can also pass options of `colmap lazy_localizer`.
"""

import argparse
import pathlib
import signal
import socket
import sys
import warnings
from collections.abc import Sequence

from colmap_lazyloc.errors import InputError, Parser, command, logger, nearest, positive_int
from colmap_lazyloc.settings import list_options

LOOPBACK = ("127.0.0.1", "::1", "localhost")


def parse_arguments(arguments: Sequence[str] | None) -> tuple[argparse.Namespace, dict[str, str]]:
    """Returns our options, and those of the localizer."""
    parser = Parser(
        prog="lazyloc serve",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        is_foreign=lambda name: True,  # an option of lazy_localizer, which the localizer checks
    )
    add = parser.add_argument
    add("model", metavar="MODEL", type=pathlib.Path, help="folder of a COLMAP model, or output folder of lazyloc run")
    add(
        "--database_path",
        type=pathlib.Path,
        help="COLMAP database with the features of the posed images; opened read-only; default: database.db beside "
        "MODEL",
    )
    add("--host", default="127.0.0.1", help="address to listen on; 0.0.0.0: all IPv4 addresses; default: %(default)s")
    add("--port", type=_port, default=8000, help="port to listen on; 0: any free port; default: %(default)s")
    add(
        "--tokens",
        type=pathlib.Path,
        metavar="FILE",
        help="file with one bearer token per line; each request needs one of these tokens; default: no token is needed",
    )
    add = parser.add_argument_group("limits").add_argument
    add("--max_megabytes", type=positive_int, default=20, help="maximum megabytes per request; default: %(default)s")
    add("--max_megapixels", type=positive_int, default=64, help="maximum megapixels per photo; default: %(default)s")
    add(
        "--max_queue",
        type=positive_int,
        default=16,
        help="maximum number of waiting photos; further photos get HTTP status 503; default: %(default)s",
    )
    add(
        "--max_seconds",
        type=positive_int,
        default=60,
        help="maximum seconds from a request to its answer; default: %(default)s",
    )
    options, words = parser.parse_known_args(arguments)
    settings = _parse_words(words)
    known = list_options()
    for name in settings:
        if name not in known and all(option.rpartition(".")[2] != name for option in known):
            near = nearest(f"--{name}", [f"--{word}" for word in (*vars(options), *known)])
            raise InputError(f"unknown option --{name}{near}")
    return options, settings


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to 65535, but is '{text}'")
    return int(text)


def _parse_words(words: Sequence[str]) -> dict[str, str]:
    """Returns values by name of words like `--name value` and `--name=value`."""
    options: dict[str, str] = {}
    rest = iter(words)
    for word in rest:
        name, has_value, value = word.partition("=")
        if not name.startswith("--") or name == "--":
            raise InputError(f"unknown argument {word}")
        text = value if has_value else next(rest, None)
        if text is None:
            raise InputError(f"option {name}: a value is missing")
        if name[2:] in options:
            raise InputError(f"option {name} is given twice")
        options[name[2:]] = text
    return options


@command(name="lazyloc serve", extra="serve")
def main(arguments: Sequence[str] | None = None) -> None:
    options, settings = parse_arguments(arguments)
    import PIL.Image

    from colmap_lazyloc.serve.app import make_app
    from colmap_lazyloc.serve.limits import Limits
    from colmap_lazyloc.serve.map import CurrentMap, Source
    from colmap_lazyloc.serve.server import make_server
    from colmap_lazyloc.serve.service import Service
    from colmap_lazyloc.serve.tokens import Tokens

    warnings.showwarning = lambda message, *_: logger.warning("%s", message)
    PIL.Image.MAX_IMAGE_PIXELS = None  # the service has a limit of its own, and Pillow would only warn
    tokens = None if options.tokens is None else Tokens(options.tokens)
    if tokens is None and options.host not in LOOPBACK:
        logger.warning("without --tokens, everybody who reaches %s may localize photos", options.host)
    limits = Limits(
        options.max_megabytes * 1_000_000, options.max_megapixels * 1_000_000, options.max_queue, options.max_seconds
    )
    service = Service(CurrentMap(Source(options.model, options.database_path, settings)), limits)
    server = make_server(make_app(service, tokens), options.max_seconds)
    with _listen(options.host, options.port) as listener:
        # From now on, SIGTERM ends the service in order: what has begun is answered. uvicorn raises the signal once
        # more at the end, for the handler that it found here.
        signal.signal(signal.SIGTERM, server.handle_exit)
        host, port = listener.getsockname()[:2]
        shown = f"[{host}]" if ":" in host else host
        logger.info("http://%s:%d/ (%d photos at a time)", shown, port, service.queue.num_threads)
        server.run(sockets=[listener])
    service.queue.close()


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise InputError(f"--host {host} --port {port}: {error.strerror}") from None


if __name__ == "__main__":
    sys.exit(main())
