"""What the service counts, as text for Prometheus."""

import bisect
from collections import Counter
from collections.abc import Iterable, Mapping

SECONDS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0)  # upper bounds of the histogram


class Metrics:
    """Counts requests and results; used by the thread of the event loop alone."""

    def __init__(self, paths: Iterable[str]):
        """`paths`: those of the service; any other path counts as "other", so that no client can add lines."""
        self._paths = frozenset(paths)
        self._requests: Counter[tuple[str, int]] = Counter()
        self._results: Counter[str] = Counter()
        self._num_in_bucket = [0] * (len(SECONDS) + 1)
        self._total_seconds = 0.0

    def add_request(self, path: str, status: int) -> None:
        self._requests[path if path in self._paths else "other", status] += 1

    def add_result(self, status: str, seconds: float) -> None:
        """`status`: that of the query; `seconds`: from the request's head to its answer."""
        self._results[status] += 1
        self._num_in_bucket[bisect.bisect_left(SECONDS, seconds)] += 1
        self._total_seconds += seconds

    def text(self, gauges: Mapping[str, tuple[str, float]]) -> str:
        """Returns all in the text format 0.0.4. `gauges`: help and value of each."""
        requests = [
            f'lazyloc_requests_total{{path="{path}",status="{status}"}} {count}'
            for (path, status), count in sorted(self._requests.items())
        ]
        results = [
            f'lazyloc_results_total{{status="{status}"}} {count}' for status, count in sorted(self._results.items())
        ]
        lines = _family("requests_total", "counter", "Requests by path and HTTP status.", requests)
        lines += _family("results_total", "counter", "Answered photos by the status of the query.", results)
        lines += _family("request_seconds", "histogram", "Seconds until a photo was answered.", self._histogram())
        for name, (text, value) in gauges.items():
            lines += _family(name, "gauge", text, [f"lazyloc_{name} {value}"])
        return "\n".join(lines) + "\n"

    def _histogram(self) -> list[str]:
        lines, count = [], 0
        for bound, num in zip((*map(str, SECONDS), "+Inf"), self._num_in_bucket):
            count += num
            lines.append(f'lazyloc_request_seconds_bucket{{le="{bound}"}} {count}')
        return [*lines, f"lazyloc_request_seconds_sum {self._total_seconds}", f"lazyloc_request_seconds_count {count}"]


def _family(name: str, kind: str, text: str, lines: list[str]) -> list[str]:
    return [f"# HELP lazyloc_{name} {text}", f"# TYPE lazyloc_{name} {kind}", *lines]
