"""Judges whether a comment opens with a sentence, by lists of words (words.txt) instead of a grammar.

A comment opens with a sentence if its first sentence

- starts with a verb ("Returns the pose", "Make sure that"), or with what a result means ("True if"), or
- has a main clause, that is a verb that no subordinate clause uses up: "The identity is what COLMAP stores" and "What
  was removed stays" have one, "None where COLMAP has set no pose" has none, or
- states a formula ("rho = log(1 + r^2)"), or describes a parameter by its name ("path: must not exist yet").

A word that is a noun as often as a verb (matches, points, sets) counts as a verb only if its neighbours allow it.
"""

import pathlib
import re


def read_words():
    """Reads the lists of words: by section, a list each."""
    text = re.sub(r"#.*", "", pathlib.Path(__file__).with_name("words.txt").read_text(encoding="utf-8"))
    sections = re.split(r"\[(\w+)\]", text)[1:]
    return {name: words.split() for name, words in zip(sections[::2], sections[1::2], strict=True)}


def third_person(verb):
    """Returns the form for "it": "returns", "carries", "misses"."""
    if verb in ("have", "do", "go"):
        return {"have": "has", "do": "does", "go": "goes"}[verb]
    if re.search(r"[^aeiou]y$", verb):
        return verb[:-1] + "ies"
    return verb + ("es" if re.search(r"(s|x|z|ch|sh)$", verb) else "s")


WORDS = read_words()
VERBS = {*WORDS["verbs"], *map(third_person, WORDS["verbs"]), *WORDS["third_persons"]}
AMBIGUOUS = {*WORDS["ambiguous"], *map(third_person, WORDS["ambiguous"])}
AUXILIARIES = {*WORDS["auxiliaries"]}
SUBORDINATORS = {*WORDS["subordinators"]}
ARTICLES = {"the", "a", "an", "its", "their", "it", "them", "each", "every"}
RESULTS = re.compile(
    r"`?(true|false|nullopt|null|nullptr|nan|empty|zero|infinite|negative|valid|thrown|called|used|not used|unused|set|"
    r"unset|deprecated|\d+|-1)`?,? (if|unless|when|while|until|by|before|after|for|means)\b",
    re.IGNORECASE,
)
LABEL = re.compile(r"(`?[a-z_][\w.]*`?(, `?[\w.]+`?)*|Arguments|Example|Examples|Input|Note|Output|Rules|See):\s")
FORMULA = re.compile(r"\s(=|<-|->|<=|>=|-=|\+=|==)\s")


def first_sentence(text):
    """Returns the text up to the end of its first sentence; a colon or a semicolon ends it too."""
    text = re.sub(r"\b(e\.g|i\.e|et al|cf|vs|no)\.", r"\1", text, flags=re.IGNORECASE)
    return re.split(r"[.!?](?:\s|$)|[;:](?:\s|$)", text, maxsplit=1)[0]


def words_of(sentence):
    """Returns the words in lower case, and commas; code and quotations are one word each."""
    sentence = re.sub(r"`[^`]*`|\"[^\"]*\"|\b[\w.]+\(\)|\b\w+::\w+|\b\w+_\w+", " X ", sentence)
    sentence = re.sub(r"\([^()]*\)", " ", sentence)
    return re.findall(r"[a-z][a-z'-]*|\d+|,", sentence.lower())


def starts_with_verb(sentence):
    """True if the first word is a verb (an adverb may stand before it)."""
    words = words_of(sentence)
    if len(words) > 1 and words[0].endswith("ly"):
        words = words[1:]
    if not words:
        return False
    first, following = words[0], words[1] if len(words) > 1 else ""
    if first in VERBS or first in ("do", "don't"):
        return True
    if first in AMBIGUOUS and not first.endswith("s"):
        return following in ARTICLES  # an order: "Set the flag"
    # Any other word on -s is a verb unless what follows makes it a plural: "Renders the scene", "Cameras in a chain".
    is_alone = following in ("", ",") or following.isdigit()
    is_verb_like = first in AMBIGUOUS or re.fullmatch(r"[a-z-]+[^aisu']s", first)
    return bool(is_verb_like and not is_alone and first != "its" and following not in WORDS["after_nouns"])


def is_finite_verb(words, i):
    """True if the word of index i is a verb with a subject, as far as its neighbours tell."""
    word, previous, following = words[i], words[i - 1] if i > 0 else "", words[i + 1] if i + 1 < len(words) else ""
    if previous in AUXILIARIES or previous in WORDS["before_nouns"]:
        return False
    is_verb_here = word in AMBIGUOUS and (following in ARTICLES or (previous == "x" and word.endswith("s")))
    return word in AUXILIARIES or word in VERBS or bool(is_verb_here)


def has_main_clause(sentence):
    """True if there is a verb that belongs to no subordinate clause; each of these takes the next verb."""
    open_clauses = []
    for i, word in enumerate(words := words_of(sentence)):
        if word == "," and words[0] in SUBORDINATORS:
            open_clauses.clear()  # "If the images fit so badly, the estimate starts higher"
        elif word in SUBORDINATORS or (i > 0 and word == "before"):
            open_clauses.append(word)
        elif is_finite_verb(words, i):
            if not open_clauses:
                return True
            open_clauses.pop()
        elif open_clauses[-1:] in (["that"], ["which"]) and word.endswith("ed") and words[i - 1] not in AUXILIARIES:
            open_clauses.pop()  # a past tense: "models that COLMAP 4 added"
    return False


def is_sentence(text):
    """True if the comment opens with a sentence."""
    sentence = first_sentence(text)
    if LABEL.match(text) or RESULTS.match(text) or starts_with_verb(sentence):
        return True
    if re.match(r"(of|by)\b", sentence, re.IGNORECASE):
        return False
    is_formula = FORMULA.search(sentence) and words_of(sentence)[:1] not in [[word] for word in WORDS["openers"]]
    return bool(is_formula) or has_main_clause(sentence)


def opens_in_the_middle(text):
    """True if the comment begins as if a sentence had gone before: "Of the query", "The same without noise"."""
    words = words_of(first_sentence(text))
    if not words or is_sentence(text):
        return False
    return words[0] in WORDS["openers"] or words[:2] == ["the", "same"]
