"""Writes the shell command that repeats a query alone."""

import shlex

from colmap_lazyloc.report.run import Run


def repeat_command(run: Run, result: dict, query_lines: dict[str, str]) -> str:
    """Returns the command; `query_lines`: the lines of the query list by name."""
    names = [result["name"]]
    lines = [query_lines.get(name, name) for name in names]
    return (
        f"printf '%s\\n' {shlex.join(lines)} > query.txt && colmap lazy_localizer "
        f"--project_path {shlex.quote(str(run.path / 'options.ini'))} --query_list_path query.txt --output_path query"
    )
