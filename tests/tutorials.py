"""Reads the tutorials' pages, and runs what they tell the reader to type.

In docs/tutorials/, a block of `sh` is run, and a block of `python` with a title is written to the file of that name. A
block of `text` right after a block of `sh` is what it prints: each of its lines must be printed, in this order. Numbers
with a decimal point may differ, because other processors round differently; `...` stands for any lines. The blocks of
`console` on the first page set up the commands, in a wheel's environment and in a checkout.
"""

import dataclasses
import pathlib
import re
import subprocess

import yaml

DOCS_PATH = pathlib.Path(__file__).resolve().parents[1] / "docs"
FENCE = re.compile(r"^```(\w*)(?: title=\"([^\"]+)\")?\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
MAX_SECONDS = 600  # a block that takes longer hangs


@dataclasses.dataclass(frozen=True)
class Block:
    """A fenced block of a page; `output` is the block of text after it."""

    page: str
    line: int
    language: str
    title: str
    text: str
    output: str


def list_pages():
    """Returns the paths of the tutorials in the order of the site."""
    text = (DOCS_PATH.parent / "mkdocs.yml").read_text()
    (pages,) = (section["Tutorials"] for section in yaml.safe_load(text)["nav"] if "Tutorials" in section)
    return [DOCS_PATH / page for page in pages]


def read_blocks(path):
    text = path.read_text(encoding="utf-8")
    found = list(FENCE.finditer(text))
    blocks = []
    for match, following in zip(found, [*found[1:], None]):
        has_output = following is not None and following.group(1) == "text" and is_next(text, match, following)
        line = text.count("\n", 0, match.start()) + 1
        output = following.group(3) if has_output else ""
        blocks.append(Block(path.name, line, match.group(1), match.group(2) or "", match.group(3), output))
    return blocks


def is_next(text, match, following):
    """True if only a short sentence stands between two blocks."""
    return len(text[match.end() : following.start()].split()) <= 12


def find_unused(blocks):
    """Returns the blocks of a page that no test runs or compares."""
    typed = "".join(block.text for block in blocks if block.language == "sh")
    printed = [block.output for block in blocks if block.language == "sh"]
    return [
        block
        for block in blocks
        if not (
            block.language == "sh"
            or (block.language == "text" and block.text in printed)
            or (block.language == "python" and block.title and f"python {block.title}" in typed)
        )
    ]


def read_setup():
    """Returns what the first page tells the reader to type before the tutorials: after the wheel, and in a checkout."""
    with_wheel, in_checkout = (block.text for block in read_blocks(list_pages()[0]) if block.language == "console")
    return with_wheel, in_checkout


def run_block(block, folder, environment):
    """Does what a block says, and fails if a command fails or prints something else."""
    where = f"{block.page}:{block.line}"
    if block.language == "python" and block.title:
        (folder / block.title).write_text(block.text, encoding="utf-8")
    if block.language != "sh":
        return
    command = ["bash", "-euo", "pipefail", "-c", block.text]
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=MAX_SECONDS,
    )
    assert done.returncode == 0, f"{where}: exit code {done.returncode}\n{done.stdout}"
    missing = find_missing(block.output, done.stdout)
    assert missing is None, f"{where}: does not print\n{missing}\nbut\n{done.stdout}"


def find_missing(expected, printed):
    """Returns the first expected line that is not printed after those before it; None if all are."""
    rest = iter(map(normalise, printed.splitlines()))
    for line in expected.splitlines():
        if line.strip() not in ("", "...") and normalise(line) not in rest:
            return line
    return None


def normalise(line):
    """Replaces numbers with a decimal point, and runs of blanks."""
    return " ".join(re.sub(r"-?\d+\.\d+(e-?\d+)?", "#", line).split())
