"""Finds comments, scopes, functions and fields in C++ source, as far as the checks need them; it is not a compiler."""

import dataclasses
import re

# Raw strings come first, because their content may look like anything.
COMMENT_OR_STRING = re.compile(
    r'R"(?P<tag>[^\s()\\]{0,16})\(.*?\)(?P=tag)"'
    r'|"(?:\\.|[^"\\\n])*"'
    r"|(?<![0-9a-fA-F])'(?:\\.|[^'\\\n])+'"
    r"|//[^\n]*|/\*.*?\*/",
    re.DOTALL,
)
DIRECTIVE = re.compile(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", re.MULTILINE)
ACCESS = re.compile(r"\s*(public|private|protected)\s*:$")
INITIALIZER_LIST = re.compile(r"\)\s*(noexcept\s*)?:(?!:)")
MACRO = re.compile(r"(TYPED_)?TEST(_F|_P)?$|[A-Z][A-Z0-9_]+$")


@dataclasses.dataclass
class Function:
    """A function with a body."""

    name: str
    first_line: int  # line of the opening brace, counted from 1
    last_line: int  # line of the closing brace

    @property
    def num_lines(self):
        """Number of lines between the braces; a body on one line counts as 1."""
        return max(1, self.last_line - self.first_line - 1)


@dataclasses.dataclass
class Comment:
    """Consecutive lines of comment without code on them."""

    line: int
    text: str
    kind: str  # what follows: function, data, type, statement, or none (an empty line or a directive)


@dataclasses.dataclass
class Scope:
    """An open brace."""

    kind: str  # namespace, type, function, block (within a function) or value (an initialiser)
    head: str  # the code before the brace
    line: int
    access: str = "public"


def blank_out(text):
    """Returns the code with comments, directives and the content of strings replaced by blanks, in the same lines."""

    def blank(match):
        blanks = re.sub(r"[^\n]", " ", match.group())
        return blanks if match.group()[0] in "/ \t#" else f'"{blanks[1:-1]}"'

    return DIRECTIVE.sub(blank, COMMENT_OR_STRING.sub(blank, text))


def without_template_arguments(head):
    """Removes the text in angle brackets, innermost first."""
    previous = None
    while previous != head:
        previous, head = head, re.sub(r"<[^<>()]*(?:\([^()]*\)[^<>()]*)*>", "", head)
    return head


def declaration_kind(head):
    """Returns what the text before a `{` or `;` declares: namespace, type, function or data."""
    head = re.sub(r"^\s*template\s*", "", without_template_arguments(head)).strip()
    if re.match(r"(inline\s+)?namespace\b|extern\s*\"", head):
        return "namespace"
    if re.match(r"(using|typedef|friend|class|struct|union|enum)\b", head) and "(" not in head:
        return "type"
    before_value = head if "operator" in head else re.split(r"(?<![=!<>])=(?!=)", head)[0]
    return "function" if "(" in before_value else "data"


def function_name(head):
    """Returns the name before the parameters; for a macro such as TEST, its arguments too."""
    match = re.search(r"(operator\s*(?:\(\)|[^\s\w(]+|\w+)|[\w:~]+)\s*\(([^()]*)", without_template_arguments(head))
    if not match:
        return "?"
    name = match.group(1)
    return f"{name}({match.group(2).strip()})" if MACRO.match(name) else name


class Source:
    """The scopes, functions and public fields of one file."""

    def __init__(self, text):
        self.lines = text.split("\n")
        self.code_lines = blank_out(text).split("\n")
        self.functions = []
        self.fields = []  # (line, type, declaration) of public data members
        self.scope_of_line = []  # kind of the innermost scope at the start of each line
        self._scopes = [Scope("namespace", "", 0)]
        self._head = ""
        for number, code in enumerate(self.code_lines, start=1):
            self.scope_of_line.append(self._scopes[-1].kind)
            for character in code + "\n":
                self._take(character, number)

    def _take(self, character, line):
        scope = self._scopes[-1]
        if character == "{":
            self._scopes.append(Scope(self._kind_of_brace(), self._head, line, self._default_access()))
            self._head = ""
        elif character == "}" and len(self._scopes) > 1:
            self._close(self._scopes.pop(), line)
        elif scope.kind in ("function", "block", "value"):
            return
        elif character == ";":
            self._end_declaration(line)
        else:
            self._head += character
            if character == ":" and (access := ACCESS.fullmatch(self._head)):
                scope.access, self._head = access.group(1), ""

    def _kind_of_brace(self):
        outer, head = self._scopes[-1].kind, self._head
        if outer in ("function", "block"):
            return "block"
        if outer == "value" or head.count("(") > head.count(")"):
            return "value"
        kind = declaration_kind(head)
        if kind == "function" and INITIALIZER_LIST.search(head) and re.search(r"\w\s*$", head):
            return "value"  # a member that a constructor initialises with braces
        return "value" if kind == "data" else kind

    def _default_access(self):
        return "private" if re.search(r"^\s*(template\b.*)?class\b", self._head, re.DOTALL) else "public"

    def _close(self, scope, line):
        if scope.kind == "function":
            self.functions.append(Function(function_name(scope.head), scope.line, line))
        self._head = scope.head + "{}" if scope.kind == "value" else ""

    def _end_declaration(self, line):
        scope, head = self._scopes[-1], self._head.strip()
        self._head = ""
        if scope.kind != "type" or scope.access != "public" or not head or re.match(r"static\b", head):
            return
        owner = re.search(r"\b(?:struct|class|union)\s+(\w+)", scope.head)
        if owner and declaration_kind(head) == "data":
            self.fields.append((line, owner.group(1), " ".join(head.split())))

    def comments(self):
        """Returns the blocks of `//` lines, without marks for tools and empty ones."""
        found, i = [], 0
        while i < len(self.lines):
            begin = i
            while i < len(self.lines) and self.lines[i].lstrip().startswith("//"):
                i += 1
            if i > begin:
                text = " ".join(line.strip().lstrip("/").strip() for line in self.lines[begin:i])
                found.append(Comment(begin + 1, text, self._kind_of_code_at(i)))
            i += 1
        return [comment for comment in found if not re.match(r"NOLINT|clang-format|[-=]*$", comment.text)]

    def _kind_of_code_at(self, i):
        """Returns the kind of code that begins at the line of index i."""
        if i >= len(self.lines) or not self.code_lines[i].strip() or self.code_lines[i].lstrip().startswith("}"):
            return "none"
        scope = self.scope_of_line[i]
        if scope in ("function", "block"):
            return "statement"
        if scope == "value":
            return "data"
        head = re.split(r"[{;]", "\n".join(self.code_lines[i : i + 12]))[0]
        if re.match(r"\s*(TEST|TYPED_TEST|INSTANTIATE|BENCHMARK|static_assert)", head):
            return "statement"
        kind = declaration_kind(head)
        return "type" if kind == "namespace" else kind
