"""Times `lazyloc serve` with 1, 8 and 64 clients, beside `localize_all`, and checks each answer.

    python -m benchmarks service DATABASE MODEL PHOTO...
    python -m benchmarks service DATABASE MODEL PHOTO... --num_services 1 2 4

A quarter of the requests are the photos; the others are what a service gets, too: no photos, damaged ones, bombs, bad
fields, wrong tokens, senders that are slow or gone. Clients that get 503 try again after the time that it states. Exits
with 1 if a request has no answer or a wrong one: a photo's must have the pose of `localize_all`, bit for bit. With
--num_services, compares the time of a core and the memory of so many services, with one thread each, with those of one
service with so many threads.
"""

import argparse
import asyncio
import collections
import concurrent.futures
import dataclasses
import functools
import itertools
import json
import os
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import time
import zlib

import httpx
import numpy as np

import colmap_lazyloc as ll

NUM_WARM_UP = 20  # photos, until caches are full


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of request and the status that it should have; None: there is nobody to answer."""

    name: str
    statuses: tuple[int | None, ...]


PHOTO = Kind("photo", (200,))
GARBAGE = Kind("no photo", (415,))
CUT_OFF = Kind("cut-off photo", (200, 415, 422))
BOMB = Kind("bomb", (413,))
BAD_FIELD = Kind("bad field", (422,))
SLOW = Kind("slow sender", (200,))
DROPPED = Kind("dropped connection", (None,))
EMPTY = Kind("empty", (400,))
WRONG_TOKEN = Kind("wrong token", (401,))
MIX = (PHOTO, GARBAGE, CUT_OFF, BOMB, PHOTO, BAD_FIELD, DROPPED, EMPTY, PHOTO, SLOW, GARBAGE, DROPPED)
MIX += (WRONG_TOKEN, BOMB, BAD_FIELD, EMPTY)
TOKEN = "token-of-the-benchmark"
HEADERS = {"Authorization": f"Bearer {TOKEN}"}


def make_bomb():
    """Returns a PNG file of 10^10 pixels by its head, with nothing in it."""
    head = b"IHDR" + struct.pack(">IIBBBBB", 100000, 100000, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))
    return b"\x89PNG\r\n\x1a\n" + chunk + struct.pack(">I", 1000) + b"IDAT" + bytes(1004)


class Load:
    """Requests of a mix, one after the other for each client, and what became of them."""

    def __init__(self, port, photos, expected):
        """`photos`: bytes by name; `expected`: the pose of each by `localize_all`."""
        self.port, self.photos, self.expected = port, photos, expected
        self.seconds, self.busy, self.problems = [], 0, []
        self.statuses = collections.Counter()

    async def run(self, num_clients, num_requests, kinds):
        """Returns the seconds that all has taken."""
        work = iter(zip(range(num_requests), itertools.cycle(kinds), itertools.cycle(self.photos)))
        start = time.monotonic()
        limits = httpx.Limits(max_connections=num_clients)
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{self.port}", timeout=120, limits=limits) as client:
            await asyncio.gather(*(self._work(client, work) for _ in range(num_clients)))
        return time.monotonic() - start

    async def _work(self, client, work):
        for index, kind, name in work:
            try:
                status = await self._request(client, index, kind, name)
            except (httpx.HTTPError, OSError) as error:
                status = type(error).__name__
            self.statuses[kind.name, status] += 1
            if status not in kind.statuses:
                self.problems.append(f"request {index} ({kind.name}): {status}")

    async def _request(self, client, index, kind, name):
        photo = self.photos[name]
        if kind is DROPPED:
            _, writer = await asyncio.open_connection("127.0.0.1", self.port)
            head = "POST /localize HTTP/1.1\r\nHost: x\r\n"
            head += f"Authorization: {HEADERS['Authorization']}\r\nContent-Length: {len(photo)}\r\n\r\n"
            writer.write(head.encode() + photo[: len(photo) * (index % 5) // 4])  # sometimes all of it
            await writer.drain()
            writer.close()
            return None
        bodies = {GARBAGE: photo[1:], CUT_OFF: photo[: len(photo) // 2], BOMB: make_bomb(), EMPTY: b""}
        params = {"position": "1 2 3"} if kind is BAD_FIELD else {}
        headers = {"Authorization": "Bearer another"} if kind is WRONG_TOKEN else HEADERS
        start = time.monotonic()
        while True:
            body = slowly(photo) if kind is SLOW else bodies.get(kind, photo)
            answer = await client.post("/localize", content=body, params=params, headers=headers)
            if answer.status_code != 503:
                break
            self.busy += 1
            await asyncio.sleep(float(answer.headers["Retry-After"]))
        if kind is PHOTO:
            self.seconds.append(time.monotonic() - start)
        if kind in (PHOTO, SLOW) and answer.json()["cam_from_world"] != self.expected[name]:
            self.problems.append(f"request {index}: the pose of {name} is another one")
        if answer.status_code >= 400 and not isinstance(json.loads(answer.text)["detail"], str):
            self.problems.append(f"request {index}: {answer.text}")
        return answer.status_code


async def slowly(photo):
    """Yields a body over two seconds."""
    for begin in range(0, len(photo), len(photo) // 4 + 1):
        await asyncio.sleep(0.5)
        yield photo[begin : begin + len(photo) // 4 + 1]


def memory_mb(pid, name):
    """Returns the memory of a process: VmRSS now, VmHWM at most so far."""
    text = pathlib.Path(f"/proc/{pid}/status").read_text()
    return int(re.search(rf"{name}:\s*(\d+)", text).group(1)) / 1024


def start_server(options, *more):
    """Returns the process and its port."""
    command = [sys.executable, "-m", "colmap_lazyloc", "serve", options.model, "--database_path", options.database]
    command += ["--port", "0", "--max_queue", options.max_queue, *(f"--{text}" for text in options.option), *more]
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as tokens:
        tokens.write(TOKEN)
        tokens.flush()
        command += ["--tokens", tokens.name]
        process = subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True)
        return process, int(re.search(r":(\d+)/", process.stderr.readline()).group(1))


def cpu_seconds(pid, thread=""):
    """Returns the seconds of a core that a process has used, or its thread of this number."""
    words = pathlib.Path(f"/proc/{pid}/{thread}stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def proportional_mb(pid):
    """Returns the memory of a process; what n processes share counts an n-th for each."""
    return int(re.search(r"^Pss:\s*(\d+)", pathlib.Path(f"/proc/{pid}/smaps_rollup").read_text(), re.M).group(1)) / 1024


def compare_services(options, photos):
    """Prints what a photo costs with one or several services, with eight clients."""
    print("| services | threads of each | core-ms per photo | of the event loop | photos per second | MB, together |")
    print("|---|---|---|---|---|---|")
    for count in options.num_services:
        for num_services, num_threads in dict.fromkeys([(1, count), (count, 1)]):
            servers = [start_server(options, "--LazyLocalizer.num_threads", num_threads) for _ in range(num_services)]
            for num_photos in (NUM_WARM_UP * num_services, options.num_direct):
                before = [(cpu_seconds(p.pid), cpu_seconds(p.pid, f"task/{p.pid}/")) for p, _ in servers]
                start = time.monotonic()
                with concurrent.futures.ThreadPoolExecutor(8) as clients:
                    for answer in clients.map(functools.partial(post, servers, photos), range(num_photos)):
                        answer.raise_for_status()
                seconds = time.monotonic() - start
            after = [(cpu_seconds(p.pid), cpu_seconds(p.pid, f"task/{p.pid}/")) for p, _ in servers]
            total, loop = (np.subtract(after, before).sum(axis=0) / num_photos * 1000).tolist()
            cells = [num_services, num_threads, f"{total:.0f}", f"{loop:.1f}", f"{num_photos / seconds:.1f}"]
            cells += [f"{sum(proportional_mb(process.pid) for process, _ in servers):.0f}"]
            print("| " + " | ".join(map(str, cells)) + " |", flush=True)
            for process, _ in servers:
                process.terminate()
                process.communicate(timeout=120)


def post(servers, photos, index):
    """Returns the answer of one of the services to one of the photos."""
    photo = list(photos.values())[index % len(photos)]
    url = f"http://127.0.0.1:{servers[index % len(servers)][1]}/localize"
    return httpx.post(url, content=photo, headers=HEADERS, timeout=300)


def localize_directly(options, paths):
    """Returns the poses by name that `localize_all` finds, and its photos per second."""
    settings = dict(text.split("=", 1) for text in options.option)
    with ll.Localizer(options.database, options.model, options=settings) as localizer:
        queries = [ll.Photo(path, name="photo") for path in paths]
        list(localizer.localize_all(queries[:NUM_WARM_UP]))
        poses = {path.name: localizer.localize_photo(path, name="photo").as_dict()["cam_from_world"] for path in paths}
        many = [query for _, query in zip(range(options.num_direct), itertools.cycle(queries))]
        start = time.monotonic()
        list(localizer.localize_all(many))
        return poses, len(many) / (time.monotonic() - start)


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("database", type=pathlib.Path)
    parser.add_argument("model", type=pathlib.Path)
    parser.add_argument("photos", type=pathlib.Path, nargs="+")
    parser.add_argument("--num_requests", type=int, nargs="+", default=[1600], help="of one or each number of clients")
    parser.add_argument("--num_direct", type=int, default=200, help="photos for localize_all")
    parser.add_argument("--num_clients", type=int, nargs="+", default=[1, 8, 64])
    parser.add_argument("--max_queue", type=int, default=16)
    parser.add_argument("--option", action="append", default=[], metavar="NAME=VALUE", help="of the localizer")
    parser.add_argument(
        "--num_services", type=int, nargs="+", metavar="N", help="compare N services of one thread each"
    )
    options = parser.parse_args(arguments)
    if options.num_services:
        compare_services(options, {path.name: path.read_bytes() for path in options.photos})
        return 0
    # A process of its own, so that the clients have nothing of it.
    with concurrent.futures.ProcessPoolExecutor(1) as process:
        expected, rate = process.submit(localize_directly, options, options.photos).result()
    photos = {path.name: path.read_bytes() for path in options.photos}
    server, port = start_server(options)
    for _, photo in zip(range(NUM_WARM_UP), itertools.cycle(photos.values())):
        httpx.post(f"http://127.0.0.1:{port}/localize", content=photo, headers=HEADERS, timeout=120)
    print(f"localize_all: {rate:.2f} photos per second\n")
    print("| requests | clients | photos per second | p50 s | p95 s | 503 | MB before | MB after | MB at most |")
    print("|---|---|---|---|---|---|---|---|---|")
    problems, statuses = [], collections.Counter()
    nums_mixed = options.num_requests * (1 if len(options.num_requests) > 1 else len(options.num_clients))
    rows = [((PHOTO,), num_clients, options.num_direct) for num_clients in options.num_clients]
    rows += [(MIX, num_clients, num) for num_clients, num in zip(options.num_clients, nums_mixed, strict=True)]
    for kinds, num_clients, num_requests in rows:
        load, before = Load(port, photos, expected), memory_mb(server.pid, "VmRSS")
        seconds = asyncio.run(load.run(num_clients, num_requests, kinds))
        num_photos = sum(count for (_, status), count in load.statuses.items() if status == 200)
        p50, p95 = np.percentile(load.seconds, [50, 95])
        after, most = memory_mb(server.pid, "VmRSS"), memory_mb(server.pid, "VmHWM")
        cells = [f"{num_requests} {'mixed' if kinds is MIX else 'photos'}", num_clients, f"{num_photos / seconds:.2f}"]
        cells += [f"{p50:.2f}", f"{p95:.2f}", load.busy, f"{before:.0f}", f"{after:.0f}", f"{most:.0f}"]
        print("| " + " | ".join(map(str, cells)) + " |", flush=True)
        problems += load.problems
        statuses += load.statuses
    server.terminate()
    _, errors = server.communicate(timeout=120)
    problems += errors.splitlines() + ([f"exit code {server.returncode}"] if server.returncode else [])
    print()
    for (name, status), count in sorted(statuses.items(), key=str):
        print(f"{name}: {status or 'gone'}: {count}")
    print(f"{len(problems)} problems", *problems[:20], sep="\n")
    return 1 if problems else 0
