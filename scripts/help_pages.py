#!/usr/bin/env python3
"""Makes documents from the program's help, which is made from the list of options.

scripts/python.sh scripts/help_pages.py tables build/bin/colmap         # tables of docs/command_line.md
scripts/python.sh scripts/help_pages.py man build/bin/colmap FOLDER     # man pages of the Debian packages
scripts/python.sh scripts/help_pages.py wheel build/bin/colmap FOLDER   # man pages of the wheel
"""

import argparse
import pathlib
import re
import subprocess
from dataclasses import dataclass

COMMANDS = ("lazy_localizer", "lazy_epoch", "lazy_indexer", "lazy_merger")
PROGRAM = "colmap-lazyloc"  # the name of the installed program; Debian's own is colmap
TOOL = "lazyloc"
OTHER_TOPICS = (  # of the options that --help leaves out, by the beginning of their names
    ("Other options", r"(?!LazyLocalizer\.Advanced|SiftExtraction|Aliked|FeatureMatching|ImageReader\.camera_model)"),
    ("Advanced options of the method", r"LazyLocalizer\."),
    ("Features of photos", r""),
)
OPTION_PATTERN = r"^  (?:-h \[ )?--([\w.-]+)(?: \])?( arg)?(?: \(=(.*?)\))? +(.*)$"


@dataclass(frozen=True)
class Option:
    """An option in the help."""

    name: str
    has_value: bool
    default: str
    text: str


@dataclass(frozen=True)
class Help:
    """The help of a command: what it does, and its options by the title of their section."""

    purpose: str
    sections: dict[str, list[Option]]


def run(*command) -> str:
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True).stdout


def read_help(program: pathlib.Path, command: str) -> Help:
    """Runs the program and returns the help of all options."""
    is_localizer = command == "lazy_localizer"
    text = run(program, command, "--help-all" if is_localizer else "--help")
    purpose = text.splitlines()[0].partition(": ")[2].rstrip(".")
    text = re.sub(r" *\n {20,}", " ", text)
    parts = zip(("Options", "Advanced options"), text.split("\nAdvanced options:\n"))
    return Help(purpose, {title: [read_option(*found) for found in find_options(part)] for title, part in parts})


def find_options(text: str) -> list[tuple[str, str, str, str]]:
    return re.findall(OPTION_PATTERN, text, re.MULTILINE)


def read_option(name: str, argument: str, default: str, text: str) -> Option:
    if re.match(r"[-\d]", default):
        default = f"{float(default):g}"
    return Option(name, bool(argument), default, text.strip())


def make_tables(program: pathlib.Path) -> str:
    """Returns the tables of docs/command_line.md: the options of --help by topic, then the others by their prefix."""
    everything = read_help(program, "lazy_localizer").sections
    options = {option.name: option for section in everything.values() for option in section}
    lines: list[str] = []
    for title, names in read_topics(program, list(options)):
        lines += ["", f"### {title}", "", "| option | default | effect |", "|---|---|---|"]
        for name in names:
            text = re.sub(r"(?<![`\w-])--\w[\w.]*\w", r"`\g<0>`", options[name].text)
            lines.append(f"| `--{name}` | {options[name].default} | {text} |")
    return "\n".join(lines).lstrip() + "\n"


def read_topics(program: pathlib.Path, names: list[str]) -> list[tuple[str, list[str]]]:
    """Returns the names of options by topic: those of --help, then the others."""
    parts = re.split(r"^(\w[\w ]*):\n", run(program, "lazy_localizer", "--help"), flags=re.MULTILINE)[1:]
    topics = [(title, [found[0] for found in find_options(part)]) for title, part in zip(parts[::2], parts[1::2])]
    topics = [(title, found) for title, found in topics if found]
    rest = [name for name in names if not any(name in found for _, found in topics)]
    for title, pattern in OTHER_TOPICS:
        topics.append((title, [name for name in rest if re.match(pattern, name)]))
        rest = [name for name in rest if not re.match(pattern, name)]
    return topics


def escape(text: str) -> str:
    """Returns a text as groff shows it literally."""
    text = text.replace("\\", r"\e").replace("-", r"\-")
    return re.sub(r"^([.'])", r"\&\1", text, flags=re.MULTILINE)


def make_page(name: str, purpose: str, synopsis: str, body: list[str], names: list[str]) -> str:
    """Returns a man page, which refers to the other names."""
    see_also = ", ".join(rf"\fB{escape(other)}\fR(1)" for other in names if other != name)
    lines = [f'.TH {name.upper()} 1 "" "colmap_lazyloc" "User Commands"', ".SH NAME"]
    lines += [f"{escape(name)} \\- {escape(purpose)}", ".SH SYNOPSIS", rf"\fB{escape(name)}\fR {escape(synopsis)}"]
    return "\n".join([*lines, *body, ".SH SEE ALSO", see_also]) + "\n"


def describe_options(sections: dict[str, list[Option]]) -> list[str]:
    lines = []
    for title, options in sections.items():
        lines.append(f".SH {title.upper()}")
        for option in options:
            value = r" \fIvalue\fR" if option.has_value else ""
            default = f" (default: {option.default})" if option.default else ""
            lines += [".TP", rf"\fB\-\-{escape(option.name)}\fR{value}", escape(option.text + default)]
    return lines


def command_page(program: pathlib.Path, command: str, names: list[str]) -> str:
    found = read_help(program, command)
    body = [".SH DESCRIPTION", f"{escape(command)} {escape(found.purpose)}."]
    if PROGRAM in names:
        body.append(rf"The same as \fB{escape(PROGRAM)} {command}\fR.")
    body += describe_options(found.sections)
    return make_page(command, found.purpose, "--option value ...", body, names)


def program_page(program: pathlib.Path, names: list[str]) -> str:
    commands = run(program, "help").split("Available commands:")[1].split()
    body = [".SH DESCRIPTION", "Runs a command of COLMAP, or one of the commands that colmap_lazyloc adds:"]
    for command in COMMANDS:
        body += [".TP", rf"\fB{command}\fR", escape(read_help(program, command).purpose) + "."]
    body += [".SH COMMANDS", escape(", ".join(commands)) + ".", ".PP"]
    body.append(escape("The option -h after a command prints the command's options."))
    return make_page(PROGRAM, "COLMAP with lazy visual localization", "command --option value ...", body, names)


def tool_page(names: list[str]) -> str:
    """Returns the man page of the tool lazyloc."""
    from colmap_lazyloc.__main__ import COMMANDS as TOOL_COMMANDS

    body = [".SH DESCRIPTION", "Finds out where photos were taken, from photos with known poses.", ".SH COMMANDS"]
    for name, (_, purpose) in TOOL_COMMANDS.items():
        body += [".TP", rf"\fB{name}\fR", escape(purpose[0].upper() + purpose[1:]) + "."]
    body += [".PP", escape("The option --help after a command prints the command's options.")]
    purpose = "find where photos were taken, from photos with known poses"
    return make_page(TOOL, purpose, "command [options]", body, names)


def write_man_pages(program: pathlib.Path, folder: pathlib.Path, names: list[str]) -> None:
    """Writes a page for each of the names, which refer to each other."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        if name == TOOL:
            page = tool_page(names)
        elif name == PROGRAM:
            page = program_page(program, names)
        else:
            page = command_page(program, name, names)
        (folder / f"{name}.1").write_text(page, encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=("tables", "man", "wheel"))
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path, nargs="?", default=pathlib.Path("."), help="for the man pages")
    options = parser.parse_args()
    if options.kind == "tables":
        print(make_tables(options.program), end="")
    else:
        names = [TOOL, *COMMANDS] if options.kind == "wheel" else [PROGRAM, TOOL, *COMMANDS]
        write_man_pages(options.program, options.folder, names)


if __name__ == "__main__":
    main()
