#!/usr/bin/env python3
"""Checks that comments open with a sentence: less than 3 % of the blocks may open with a fragment.

A block is consecutive lines of comment with no code on them; comments at the end of a line of code are not counted.
A fragment is

- before a function or a statement: all that is no sentence (sentences.py says what that is), since a function's comment
  begins with a verb;
- before data or a type: only what begins in the middle ("Of the query", "None where", "The same without"), since a noun
  phrase may name a field or a type ("Standard deviation of its image points' errors");
- alone (before an empty line, at the head of a file): as before data.

C++ and Python (comments and docstrings) are counted by the same rules, each language for itself.
"""

import ast
import io
import re
import sys
import tokenize

import sentences
import tree
from cpp_source import Comment, Source

MAX_RATIO = 0.03
NOUNS_ALLOWED = ("data", "type", "none")


def is_fragment(comment):
    """True if the block opens with a fragment."""
    if comment.kind in NOUNS_ALLOWED:
        return sentences.opens_in_the_middle(comment.text)
    return not sentences.is_sentence(comment.text)


def docstring_kind(node):
    """Returns what a docstring describes; properties and fixtures are named by nouns, like data."""
    if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
        return "type"
    decorators = " ".join(ast.unparse(decorator) for decorator in node.decorator_list)
    return "data" if "property" in decorators or "fixture" in decorators else "function"


def line_kind(line):
    """Returns what follows a block of `#` lines, from its next line: data, a statement, or none for an empty line."""
    if not line.strip():
        return "none"
    return "data" if re.match(r"\w+(:[^=]*)? = ", line) else "statement"


def python_comments(text):
    """Returns the docstrings and the blocks of `#` lines of a Python file."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)) and ast.get_docstring(
            node
        ):
            found.append(Comment(node.body[0].lineno, " ".join(ast.get_docstring(node).split()), docstring_kind(node)))
    lines = [*text.split("\n"), ""]
    comments = [t for t in tokenize.generate_tokens(io.StringIO(text).readline) if t.type == tokenize.COMMENT]
    own_lines = [t.start[0] for t in comments if t.line.lstrip().startswith("#") and not t.string.startswith("#!")]
    block = []
    for number in own_lines:
        block.append(lines[number - 1].strip().lstrip("#").strip())
        if number + 1 not in own_lines:
            found.append(Comment(number - len(block) + 1, " ".join(block), line_kind(lines[number])))
            block = []
    return [comment for comment in found if comment.text]


def count(paths):
    """Returns the number of blocks, and those that are fragments with their files."""
    num_blocks, fragments = 0, []
    for path in paths:
        text = path.read_text(encoding="utf-8")
        comments = python_comments(text) if path.suffix == ".py" else Source(text).comments()
        num_blocks += len(comments)
        fragments += [(path, comment) for comment in comments if is_fragment(comment)]
    return num_blocks, fragments


def ratio_text(num_blocks, fragments):
    """Returns the figures as one phrase."""
    ratio = len(fragments) / num_blocks if num_blocks else 0
    middle = sum(sentences.opens_in_the_middle(comment.text) for _, comment in fragments)
    return f"{len(fragments)} of {num_blocks} blocks are fragments ({100 * ratio:.1f} %), {middle} begin in the middle"


def main():
    """Checks all C++ and Python files."""
    root = tree.parse_root(__doc__)
    failed = []
    for language, patterns in (("Python", ("*.py",)), ("C++", ("*.h", "*.cc"))):
        num_blocks, fragments = count(tree.list_files(root, *patterns))
        for path, comment in fragments:
            print(f"{path.relative_to(root)}:{comment.line}: ({comment.kind}) {comment.text[:90]}")
        print(f"comments: {language}: {ratio_text(num_blocks, fragments)}")
        if fragments and len(fragments) >= MAX_RATIO * num_blocks:
            failed.append(language)
    if failed:
        sys.exit(f"comments: {' and '.join(failed)} comments must open with a sentence, all but {100 * MAX_RATIO:g} %")


if __name__ == "__main__":
    main()
