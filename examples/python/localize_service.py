"""A small HTTP service that localizes photos.

`curl --data-binary @photo.jpg http://localhost:8000/` returns the line of results.jsonl. One localizer stays loaded. At
most NUM_CALLS photos of at most MAX_BYTES are in work.

    python localize_service.py database.db model 8000
"""

import http.server
import sys
import tempfile
import threading

import colmap_lazyloc as ll

MAX_BYTES = 20 << 20
NUM_CALLS = 4


class Handler(http.server.BaseHTTPRequestHandler):
    """Answers one request in a thread of its own."""

    localizer: ll.Localizer
    slots = threading.BoundedSemaphore(NUM_CALLS)
    timeout = 30  # seconds, for a client that stops sending

    def do_POST(self) -> None:
        """Localizes the photo in the body."""
        size = int(self.headers.get("Content-Length", 0))
        if not 0 < size <= MAX_BYTES:
            return self.answer(413, '{"error": "send a photo of at most 20 MiB"}')
        if not self.slots.acquire(blocking=False):
            return self.answer(503, '{"error": "busy"}')
        try:
            with tempfile.NamedTemporaryFile() as file:
                file.write(self.rfile.read(size))
                file.flush()
                result = self.localizer.localize_photo(file.name, name="photo")
            self.answer(200, result.line)
        finally:
            self.slots.release()

    def answer(self, code: int, body: str) -> None:
        """Sends a JSON text."""
        self.send_response(code)
        self.send_header("Content-Type", "application/json")
        self.end_headers()
        self.wfile.write(body.encode() + b"\n")


if __name__ == "__main__":
    Handler.localizer = ll.Localizer(sys.argv[1], sys.argv[2])
    http.server.ThreadingHTTPServer(("localhost", int(sys.argv[3])), Handler).serve_forever()
