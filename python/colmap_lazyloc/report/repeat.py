"""Writes the shell command that repeats a query alone."""

import functools
import itertools
import pathlib
import shlex
import shutil

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.report.run import Run
from colmap_lazyloc.result_fields import ResultFields
from colmap_lazyloc.text_files import read_entries

MAX_NUM_TOGETHER = 50  # for larger groups, the command repeats the whole run


class RepeatCommands:
    """Writes the commands; `query_lines`: the lines of the query list by name, in its order."""

    def __init__(self, run: Run, query_lines: dict[str, str]):
        self._run, self._query_lines = run, query_lines
        # The wheel and the Debian package have a command of this name, and the wheel has no `colmap`.
        self._program = "lazy_localizer" if shutil.which("lazy_localizer") else "colmap lazy_localizer"
        self._groups = _groups(run, query_lines)

    def command(self, result: ResultFields) -> str:
        """Returns the command; empty if a list of queries cannot hold the name."""
        names = self._groups.get(result["name"], [result["name"]])
        if any(name != name.strip() or name.startswith("#") or "\n" in name or not name for name in names):
            return ""
        options = {"project_path": str((self._run.path / "options.ini").resolve())}
        values = self._run.options.values
        # Give such a path again, because the reader of options.ini takes the rest for a comment.
        options |= {name: value for name, value in values.items() if name.endswith("_path") and "#" in value}
        if values.get("LazyLocalizer.Advanced.matches_output_path"):
            options["LazyLocalizer.Advanced.matches_output_path"] = "repeated_matches.db"
        options["output_path"] = "repeated"
        has_group_list = bool(values.get("LazyLocalizer.Advanced.group_list_path"))
        if len(names) > MAX_NUM_TOGETHER or (has_group_list and any(len(name.split()) > 1 for name in names)):
            return f"{self._program} {_join(options)}"
        options["query_list_path"] = "repeated.txt"
        files = {"repeated.txt": [self._line(name) for name in names]}
        if has_group_list:
            options["LazyLocalizer.Advanced.group_list_path"] = "repeated_group.txt"
            files["repeated_group.txt"] = [" ".join(names)]
        prints = [f"printf '%s\\n' {shlex.join(lines)} > {path}" for path, lines in files.items()]
        return " && ".join([*prints, f"{self._program} {_join(options)}"])

    def _line(self, name: str) -> str:
        """Returns a line of the query list; if the list is not there any more, with the intrinsics that it gave."""
        if name in self._query_lines:
            return self._query_lines[name]
        image, source = self._run.model.images.get(name), self._sources.get(name)
        if image is not None and source == "query_list" and " " not in name:
            return f"{name} {self._run.model.cameras[image.camera_id].text()}"
        return name

    @functools.cached_property
    def _sources(self) -> dict[str, str | None]:
        return {result["name"]: result.get("intrinsics_source") for result in self._run.queries}


def _join(options: dict[str, str]) -> str:
    return " ".join(f"--{name} {shlex.quote(value)}" for name, value in options.items())


def _groups(run: Run, query_lines: dict[str, str]) -> dict[str, list[str]]:
    """Returns the queries that were localized together with each query; without those that were localized alone."""
    frame_of = {result["name"]: result.get("frame") or f"\n{result['name']}" for result in run.queries}
    frames: dict[str, list[str]] = {}
    # The order matters, because groups are runs of the query list, or of the sorted names.
    for name in [name for name in query_lines if name in frame_of] or sorted(frame_of):
        frames.setdefault(frame_of[name], []).append(name)
    size = int(run.options.values.get("LazyLocalizer.group_size", 1))
    lists = list(frames.values())
    if run.options.values.get("LazyLocalizer.Advanced.group_list_path"):
        lists = _listed_groups(run, frame_of, frames)
    elif size > 1 and not run.options.values.get("query_trajectory_path"):
        lists = [list(itertools.chain(*lists[i : i + size])) for i in range(0, len(lists), size)]
    return {name: names for names in lists if len(names) > 1 for name in names}


def _listed_groups(run: Run, frame_of: dict[str, str], frames: dict[str, list[str]]) -> list[list[str]]:
    """Returns the groups of the file of groups, with all images of their frames."""
    path = pathlib.Path(run.options.values["LazyLocalizer.Advanced.group_list_path"])
    try:
        lines = [line.split() for _, line in read_entries(path)]
    except InputError:
        return list(frames.values())
    listed = [dict.fromkeys(frame_of[name] for name in names if name in frame_of) for names in lines]
    in_groups = {frame for group in listed for frame in group}
    alone = [frame for frame in frames if frame not in in_groups]
    return [
        list(itertools.chain(*(frames[frame] for frame in group))) for group in [*listed, *([frame] for frame in alone)]
    ]
