#!/usr/bin/env python3
"""Checks that the tables of measurements in docs/ are those of the result files in benchmarks/results/.

A result file PAGE.json has the tables of a page by name: columns, and rows with date, commit, machine and cells. In the
page, the line `<!-- results: PAGE/NAME -->` stands before each table. The last column says when a row was measured, and
whether by an earlier version of the program; rows of other programs do not depend on it.

`--write` writes the tables into the pages. `--take RUN.md --page PAGE` first takes the tables of a benchmark's output
into PAGE.json, as measured today, with the commit and on the machine at hand: a table is named after its heading, and
rows that begin alike are replaced. If the page has tables already, others are left out.
"""

import argparse
import collections
import datetime
import json
import pathlib
import re
import subprocess

import tree

# Commits whose figures the present program has too. A change of the method empties this list.
PRESENT = ("2f94e86cbf", "6c8bfcf9e4", "8b49d60a45", "e67e4b58d4", "03c305bc43")
OTHER_PROGRAM = re.compile(r"map|structure_based|local[_ i]|colmap|poselib|generalized_|relative_pose_r", re.I)
MARKER = re.compile(r"^<!-- results: ([\w-]+)/([\w.-]+) -->\n\n((?:\|.*\n)+)", re.MULTILINE)
ANY_MARKER = re.compile(r"<!-- results: ([\w-]+)/([\w.-]+) -->")
HEADING_OR_TABLE = re.compile(r"^#+ (.*)$|^((?:\|.*\n?)+)", re.MULTILINE)


def cells_of(line):
    """Returns the cells of a line of a table."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def render(table):
    """Returns the table as Markdown."""
    lines = [[*table["columns"], "measured"], ["---"] * (len(table["columns"]) + 1)]
    for row in table["rows"]:
        is_present = row["commit"] in PRESENT or OTHER_PROGRAM.match(row["cells"][0].strip("*`"))
        age = "" if is_present else ", earlier"
        lines.append([*row["cells"], f"{row['date']} {row['commit'][:7]} {row['machine']}{age}"])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines).replace("| --- |", "|---|").replace(" --- |", "---|")


def read_results(root):
    """Returns the tables of each page."""
    return {
        path.stem: json.loads(path.read_text("utf-8")) for path in tree.list_files(root, "benchmarks/results/*.json")
    }


def write_results(path, tables):
    """Writes the tables of a page with a line for each row, so that a new measurement is a short difference."""
    parts = []
    for name, table in tables.items():
        rows = ",\n".join("    " + json.dumps(row, ensure_ascii=False) for row in table["rows"])
        columns = json.dumps(table["columns"], ensure_ascii=False)
        parts.append(f'  {json.dumps(name)}: {{"columns": {columns}, "rows": [\n{rows}\n  ]}}')
    path.write_text("{\n" + ",\n".join(parts) + "\n}\n", "utf-8")


def take(root, run_path, page):
    """Takes the tables of a run into the result file of a page."""
    path = root / "benchmarks" / "results" / f"{page}.json"
    tables = json.loads(path.read_text("utf-8")) if path.exists() else {}
    source, shown = measured_here(root), shown_tables(root)
    heading, taken = "", {}
    for match in HEADING_OR_TABLE.finditer(run_path.read_text("utf-8")):
        if match.group(2) is None:
            heading = re.sub(r"[^\w.]+", "_", match.group(1).lower()).strip("_")
            continue
        lines = [cells_of(line) for line in match.group(2).splitlines()]
        taken[heading] = taken.get(heading, 0) + 1
        name = heading if taken[heading] == 1 else f"{heading}-{taken[heading]}"
        if page in shown and name not in shown[page]:
            continue
        rows = [{**source, "cells": cells} for cells in lines[2:]]
        tables[name] = {"columns": lines[0], "rows": merge(tables.get(name), lines[0], rows)}
    write_results(path, tables)


def shown_tables(root):
    """Returns the names of the tables that the documentation has, by the page of their results."""
    shown = collections.defaultdict(set)
    for path in tree.list_files(root, "docs/*.md"):
        for page, name in ANY_MARKER.findall(path.read_text("utf-8")):
            shown[page].add(name)
    return shown


def merge(old, columns, rows):
    """Returns the rows of a table, new ones in the place of those that begin alike."""
    keys = [row["cells"][0] for row in rows]
    if old is None or old["columns"] != columns or len(set(keys)) < len(keys):
        return rows
    new = dict(zip(keys, rows))
    return [*(new.pop(row["cells"][0], row) for row in old["rows"]), *new.values()]


def measured_here(root):
    """Returns date, commit and machine of a measurement that is taken now."""
    commit = subprocess.run(["git", "-C", root, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout
    model = re.search(r"^model name\s*: (.*)$", pathlib.Path("/proc/cpuinfo").read_text("utf-8"), re.MULTILINE)
    name = re.search(r"EPYC|Xeon|Ryzen|Core", model.group(1) if model else "")
    machine = name.group() if name else "unknown machine"
    return {"date": datetime.date.today().isoformat(), "commit": commit.strip()[:10], "machine": machine}


def check_pages(root, is_written):
    """Returns the problems of all pages, and the number of their tables; mends tables that differ if `is_written`."""
    results, problems, used = read_results(root), [], []
    for path in tree.list_files(root, "docs/*.md"):
        text = path.read_text("utf-8")

        def expected(match):
            page, name, table = match.groups()
            if name not in results.get(page, {}):
                return match.group()
            return match.group()[: -len(table)] + render(results[page][name])

        names = ANY_MARKER.findall(text)
        used += names
        problems += [f"{path}: no results {page}/{name}" for page, name in names if name not in results.get(page, {})]
        if len(names) != len(MARKER.findall(text)):
            problems.append(f"{path}: a line of results without a table after it")
        mended = MARKER.sub(expected, text)
        if mended != text and is_written:
            path.write_text(mended, "utf-8")
        elif mended != text:
            problems.append(f"{path}: a table differs from its results; scripts/checks/tables.py --write")
    unused = {(page, name) for page, tables in results.items() for name in tables} - set(used)
    return [*problems, *(f"benchmarks/results/{page}.json: no page shows {name}" for page, name in unused)], len(used)


def main():
    """Checks all pages, or writes their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2])
    parser.add_argument("--write", action="store_true", help="write the tables into the pages")
    parser.add_argument("--take", type=pathlib.Path, help="Markdown file that a benchmark has made")
    parser.add_argument("--page", help="name of the result file; default: that of the taken file")
    arguments = parser.parse_args()
    if arguments.take:
        take(arguments.root, arguments.take, arguments.page or arguments.take.stem)
    problems, count = check_pages(arguments.root, arguments.write or arguments.take is not None)
    tree.finish("tables", problems, f"{count} tables")


if __name__ == "__main__":
    main()
