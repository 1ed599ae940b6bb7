#!/usr/bin/env python3
"""Checks that the tables of measurements in docs/ are those of the result files in benchmarks/results/.

A result file PAGE.json has the tables of a page by name: columns, and rows with date, commit, machine, cells and the
hash of the method that was measured: of the code in its folders (layers.py), without comments, tests and names of
files. In the page, the line `<!-- results: PAGE/NAME -->` stands before each table. The last column shows when a row
was measured, and "earlier method" if its hash is not that of the present code; rows of other programs do not depend
on it.

`--write` writes the tables into the pages. `--take RUN.md --page PAGE` first takes the tables of a benchmark's output
into PAGE.json, as measured today, with the commit and on the machine at hand: a table is named after its heading, and
rows that begin alike are replaced. If the page has tables already, others are left out. `--same-figures HASH` first
gives the rows of that method the present hash, for a change of the code of which a comparison has shown that it
changes no figure.
"""

import argparse
import collections
import datetime
import functools
import hashlib
import json
import pathlib
import re
import subprocess

import layers
import tree

OTHER_PROGRAM = re.compile(r"map|structure_based|local[_ i]|colmap|poselib|generalized_|relative_pose_r", re.I)
MARKER = re.compile(r"^<!-- results: ([\w-]+)/([\w.-]+) -->\n\n((?:\|.*\n)+)", re.MULTILINE)
ANY_MARKER = re.compile(r"<!-- results: ([\w-]+)/([\w.-]+) -->")
COMMENT_OR_INCLUDE = re.compile(r"//[^\n]*|/\*.*?\*/|^#include[^\n]*", re.MULTILINE | re.DOTALL)
HEADING_OR_TABLE = re.compile(r"^#+ (.*)$|^((?:\|.*\n?)+)", re.MULTILINE)


def cells_of(line):
    """Returns the cells of a line of a table."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


@functools.cache
def present_method(root):
    """Returns the hash of the method's code. Comments, blanks, includes and names of files are no part of it."""
    folders = layers.METHOD | layers.PARTS | {"pipeline"}
    paths = [path for folder in folders for path in (root / "src" / "colmap_lazyloc" / folder).rglob("*.*")]
    paths = [path for path in paths if path.suffix in (".h", ".cc") and not layers.is_test(path)]
    codes = ["".join(COMMENT_OR_INCLUDE.sub("", path.read_text("utf-8")).split()) for path in paths]
    return hashlib.sha256("\n".join(sorted(codes)).encode()).hexdigest()[:10]


def is_present(row, method):
    """True if the present program has the figures of a row, too."""
    return row.get("method") == method or bool(OTHER_PROGRAM.match(row["cells"][0].strip("*`")))


def render(table, method):
    """Returns the table as Markdown."""
    lines = [[*table["columns"], "measured"], ["---"] * (len(table["columns"]) + 1)]
    for row in table["rows"]:
        age = "" if is_present(row, method) else ", earlier method"
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
    today = datetime.date.today().isoformat()
    return {"date": today, "commit": commit.strip()[:10], "machine": machine, "method": present_method(root)}


def carry_over(root, method):
    """Gives the rows of a method the present hash."""
    for path in tree.list_files(root, "benchmarks/results/*.json"):
        text = path.read_text("utf-8")
        path.write_text(text.replace(f'"method": "{method}"', f'"method": "{present_method(root)}"'), "utf-8")


def check_pages(root, is_written):
    """Returns the problems of all pages, and a summary; mends tables that differ if `is_written`."""
    results, problems, used = read_results(root), [], []
    method = present_method(root)
    for path in tree.list_files(root, "docs/*.md"):
        text = path.read_text("utf-8")

        def expected(match):
            page, name, table = match.groups()
            if name not in results.get(page, {}):
                return match.group()
            return match.group()[: -len(table)] + render(results[page][name], method)

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
    problems += [f"benchmarks/results/{page}.json: no page shows {name}" for page, name in unused]
    rows = [row for tables in results.values() for table in tables.values() for row in table["rows"]]
    num_present = sum(is_present(row, method) for row in rows)
    return problems, f"{len(used)} tables, {num_present} of {len(rows)} rows of the present method {method}"


def main():
    """Checks all pages, or writes their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2])
    parser.add_argument("--write", action="store_true", help="write the tables into the pages")
    parser.add_argument("--take", type=pathlib.Path, help="Markdown file that a benchmark has made")
    parser.add_argument("--same-figures", metavar="HASH", help="method whose figures the present one has, too")
    parser.add_argument("--page", help="name of the result file; default: that of the taken file")
    arguments = parser.parse_args()
    if arguments.take:
        take(arguments.root, arguments.take, arguments.page or arguments.take.stem)
    if arguments.same_figures:
        carry_over(arguments.root, arguments.same_figures)
    is_written = arguments.write or arguments.take is not None or arguments.same_figures is not None
    tree.finish("tables", *check_pages(arguments.root, is_written))


if __name__ == "__main__":
    main()
