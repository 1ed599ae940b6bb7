#!/usr/bin/env python3
"""Checks the documentation's words: how long sentences are, which words are not used; and that numbers are true.

Checked are README.md, CHANGELOG.md, CONTRIBUTING.md and docs/, without what is generated and without the tables of
benchmarks. Defaults are compared with the tables of options, constants of the method with the code.
"""

import pathlib
import re

import tree

MAX_MEAN_SENTENCE = 18  # words of the sentences of a page, in the mean
MAX_SENTENCE = 50  # words of a sentence

# Words that have another meaning here, or that no stranger understands: the pattern, and what to write.
VOCABULARY = {
    r"\brivals?\b": "competing pose",
    r"\blone quer(y|ies)\b": "single query",
    r"\bdoubts?\b": "low confidence",
    r"\bask(s)? for\b": "suggest, need",
    r"\b(is|are|was|were) open\b": "unobservable",
    r"\bends?-users?\b": "users",
    r"\bsimply\b": "nothing",
    r"\butili[sz]e[sd]?\b": "use",
    r"\bin order to\b": "to",
    r"\ballows? to\b": "lets you",
}
# Constants in the method's text, and their names in the code, after a file if others have the name, too.
CONSTANTS = {
    r"fewer than (\d+) inliers": "kMinNumInliers",
    r"differ from the result by more than (\d+)°": "kMaxRotationErrorDeg",
    r"Geman-McClure with (\d+)°": "kScaleDeg",
    r"best of (\d+) directions": "kNumHypotheses",
    r"at least ([\d.]+)°\. The start": "kMinDirectionStddevDeg",
    r"use at most (\d+) tracks": "kMaxNumStartTracks",
    r"from an (\d+)x8 grid": "track_selection.cc kNumCells",
    r"see a track at ([\d.]+)° or more": "min_triangulation_angle_deg",
    r"within (\d+) standard deviations of each keypoint": "kMaxDatabaseErrorSigma",
    r"if there are fewer than (\d+) such points": "kFewTracks",
    r"It is (\d+) px in the first round": "kStartNoisePx",
    r"at least ([\d.]+) px later": "kMinImageNoisePx",
    r"expected to be ([\d.]+) px at": "kViewpointNoisePx",
    r"independent ones ([\d.]+) px": "kIndependentNoisePx",
    r"common errors of ([\d.]+) px": "kCommonNoisePx",
    r"in each of (\d+) areas": "kNumAreas",
    r"misfit by more than (\d+) px": "kMaxKeypointNoisePx",
    r"less than ([\d.]+) of their standard deviations": "bundle_adjustment.h convergence_sigma",
    r"With fewer than (\d+) tracks": "kMinNumTracks",
    r"With more than (\d+) frames": "kMaxNumDenseFrames",
    r"if \$s\$ exceeds ([\d.]+)": "depth_scale.cc kMaxStddev",
    r"from 1/3 to (\d+) times": "kMaxFocalFactor",
    r"is multiplied by (\d+), because": "kCommonErrorFactor",
    r"wrong, then off by (\d+ %)": "kWrongStddev",
    r"EXIF's of (\d+ %)": "kWrongExifProbability",
    r"Above (\d+ %), or": "kMinWrongProbability",
    r"the factor is at most (\d+)": "kMaxSmallSampleFactor",
    r"exceeds ([\d.]+) of the distance": "max_position_stddev_ratio",
    r"two queries with (\d+) tracks": "kNumEnough",
    r"O_\{place\} = ([\d.]*\d)": "kPlaceOdds",
    r"\\frac\{([\d.]*\d)\}\{n\}": "kChanceNumPoints",
    r"\\frac\{h_\{ij\}\}\{([\d.]*\d)\}": "kReferenceDistance",
    r"h = ([\d.]*\d)\\ ": "kHiddenNoisePx",
    r"exact with a probability of ([\d.]*\d %)": "kExactProbability",
    r"wrong with a probability of ([\d.]*\d %)": "kWrongGivenProbability",
    r"by more than (\d+) standard deviations": "kMaxRightErrorSigma",
    r"by more than ([\d.]*\d %) of the scene": "kMaxRightErrorRatio",
}
FENCE = re.compile(r"^ *(```|~~~).*?^ *\1\s*$", re.MULTILINE | re.DOTALL)
GENERATED = {
    "docs/command_line.md": re.compile(r"^### What you need.*?(?=^## lazy_indexer)", re.MULTILINE | re.DOTALL),
    "docs/python.md": re.compile(r"^## Reference.*", re.MULTILINE | re.DOTALL),
}
DEFAULT = re.compile(r"^\| `--(?:[\w.]+\.)?(\w+)` \| (\S+) \|", re.MULTILINE)
STATED = re.compile(r"`(?:--[\w.]+\.)?(\w+)` (?:= |\()(-?\d+(?:\.\d+)?(?: %)?)")


def pages(root):
    """Returns the text of each page by its path, without what is generated."""
    names = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md"]
    paths = [root / name for name in names if (root / name).exists()]
    found = {}
    for path in [*paths, *(path for path in tree.list_files(root, "docs/*.md") if path.is_file())]:
        name = str(path.relative_to(root))
        text = path.read_text(encoding="utf-8")
        if name in GENERATED:
            text = GENERATED[name].sub("", text)
        if name.startswith("docs/benchmarks"):
            text = "\n".join(line for line in text.splitlines() if not line.startswith("|"))
        found[name] = text
    return found


def sentences_of(text):
    """Returns the sentences of the running text: without code, tables, headings and formulas."""
    text = FENCE.sub("\n\n", text)
    text = re.sub(r"\$\$.*?\$\$", "\n\n", text, flags=re.DOTALL)
    text = re.sub(r"`[^`]*`", "X", text)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    lines = [
        "" if re.match(r"\s*(\||#|<)", line) else re.sub(r"^\s*([-*]|\d+\.) ", "\n\n", line)
        for line in text.split("\n")
    ]
    for paragraph in re.split(r"\n\s*\n", "\n".join(lines)):
        for sentence in re.split(r"(?<=[.!?:;])[\s*)]+", " ".join(paragraph.split())):
            if re.search(r"\w", sentence):
                yield sentence


def sentence_problems(name, text):
    """Returns the problems of a page's sentences."""
    lengths = []
    for sentence in sentences_of(text):
        lengths.append(len(re.findall(r"[\w'-]*[A-Za-z][\w'-]*", sentence)))
        if lengths[-1] > MAX_SENTENCE:
            yield f"{name}: {lengths[-1]} words in a sentence: {sentence[:60]}..."
    if lengths and sum(lengths) / len(lengths) > MAX_MEAN_SENTENCE:
        yield f"{name}: {sum(lengths) / len(lengths):.1f} words per sentence, of at most {MAX_MEAN_SENTENCE}"


def word_problems(name, text):
    """Returns the words that are not used in the documentation."""
    for pattern, better in VOCABULARY.items():
        for match in re.finditer(pattern, FENCE.sub("", text), re.IGNORECASE):
            yield f"{name}: '{match.group()}': write {better}"


def number(text):
    """Returns the value of a number, which may be a percentage."""
    return float(text[:-1]) / 100 if text.endswith("%") else float(text)


def default_problems(root, page, text):
    """Returns the stated defaults that are not those of the tables, which a test compares with --help."""
    defaults = dict(DEFAULT.findall((root / "docs/command_line.md").read_text(encoding="utf-8")))
    for name, value in STATED.findall(text):
        if name in defaults and abs(float(defaults[name]) - number(value)) > 1e-9:
            yield f"{page}: `{name}` is {value}, but the default is {defaults[name]}"


def constant_problems(root, text):
    """Returns the constants in the method that are not those of the code."""
    code = {path.name: path.read_text(encoding="utf-8") for path in tree.list_files(root, "*.h", "*.cc")}
    text = " ".join(text.split())
    for pattern, name in CONSTANTS.items():
        stated = re.search(pattern, text)
        file, _, name = name.rpartition(" ")
        found = re.search(rf"\b{name}(?:\[\])? = \{{?([\d.e-]+)", code[file] if file else "\n".join(code.values()))
        if stated is None or found is None:
            yield f"docs/method.md: {pattern if stated is None else name} is not found"
        elif abs(number(stated.group(1)) - float(found.group(1))) > 1e-9:
            yield f"docs/method.md: {stated.group(1)}, but {name} is {found.group(1)}"


def main():
    """Checks all pages."""
    root = pathlib.Path(tree.parse_root(__doc__))
    problems, total = [], 0
    for name, text in pages(root).items():
        total += len(text.split())
        if name != "CHANGELOG.md":
            problems += [*sentence_problems(name, text), *word_problems(name, text)]
        if not name.startswith(("docs/benchmarks", "docs/decisions")):  # which tell of earlier values, too
            problems += default_problems(root, name, text)
        if name == "docs/method.md":
            problems += constant_problems(root, text)
    tree.finish("prose", problems, f"{total} words")


if __name__ == "__main__":
    main()
