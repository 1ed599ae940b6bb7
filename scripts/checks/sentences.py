"""Judges whether a comment opens with a sentence, without a grammar: by lists of words.

A comment opens with a sentence if its first sentence

- starts with a verb ("Returns the pose", "Computes", "Make sure that"), or with what a result means ("True if"), or
- has a main clause: a finite verb before the first word that begins a subordinate clause ("The identity is what COLMAP
  stores"), or more such verbs than such words ("What was removed stays"; not "None where COLMAP has set no pose"), or
- states a formula ("rho = log(1 + r^2)"), or describes a parameter by its name ("path: must not exist yet").

The lists hold the verbs of our comments. A word that is a noun as often as a verb (matches, points, sets) counts as a
verb only at the beginning, if an article or the like follows it.
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
CLEAR_FORMS = {*WORDS["verbs"], *map(third_person, WORDS["verbs"])}
AMBIGUOUS_FORMS = {*WORDS["ambiguous"], *map(third_person, WORDS["ambiguous"])}
AUXILIARIES = {*WORDS["auxiliaries"]}
SUBORDINATORS = {*WORDS["subordinators"]}
ARTICLES = {"the", "a", "an", "its", "their", "it", "them"}
# A word after one of these is a noun.
BEFORE_NOUNS = {
    "to",
    "a",
    "an",
    "the",
    "of",
    "its",
    "their",
    "and",
    "or",
    "last",
    "first",
    "next",
    "own",
    "same",
    "other",
}
RESULTS = re.compile(
    r"`?(true|false|nullopt|null|nullptr|nan|empty|zero|infinite|negative|valid|thrown|called|used|not used|unused|set|"
    r"unset|deprecated|\d+|-1)`?,? (if|unless|when|while|until|by|before|after|for|means)\b",
    re.IGNORECASE,
)
ALWAYS_HALF = ("of", "by")


def first_sentence(text):
    """Returns the text up to the end of its first sentence; a colon or a semicolon ends it too."""
    text = re.sub(r"\b(e\.g|i\.e|et al|cf|vs|no)\.", r"\1", text, flags=re.IGNORECASE)
    return re.split(r"[.!?](?:\s|$)|[;:](?:\s|$)", text, maxsplit=1)[0]


def words_of(sentence):
    """Returns the words in lower case; code and quotations are one word each."""
    sentence = re.sub(r"`[^`]*`|\"[^\"]*\"|\b[\w.]+\(\)|\b\w+::\w+|\b\w+_\w+", " X ", sentence)
    sentence = re.sub(r"\([^()]*\)", " ", sentence)
    return re.findall(r"[a-z][a-z'-]*|\d+", sentence.lower())


def starts_with_verb(words):
    """True if the first word is a verb (an adverb may stand before it)."""
    if words and words[0].endswith("ly") and len(words) > 1:
        words = words[1:]
    if not words:
        return False
    if words[0] in AMBIGUOUS_FORMS:
        return len(words) > 1 and words[1] in WORDS["determiners"]
    return words[0] in CLEAR_FORMS or (words[0] in ("does", "is", "has", "must", "may", "can", "cannot", "do", "don't"))


def is_finite_verb(words, i):
    """True if the word of index i is a verb with a subject, as far as its neighbours tell."""
    word, previous, following = words[i], words[i - 1] if i > 0 else "", words[i + 1] if i + 1 < len(words) else ""
    if previous in AUXILIARIES or previous in BEFORE_NOUNS:
        return False
    if word.endswith("ed") and word not in CLEAR_FORMS:
        return previous in ("it", "they", "we", "which", "that", "who", "nobody")
    return word in AUXILIARIES or word in CLEAR_FORMS or (word in AMBIGUOUS_FORMS and following in ARTICLES)


def has_main_clause(words):
    """True if a finite verb comes before all words that begin a subordinate clause, or there are more of them."""
    num_verbs = num_subordinate = 0
    for i, word in enumerate(words):
        if word in SUBORDINATORS or (i > 0 and word == "before"):
            num_subordinate += 1
        elif is_finite_verb(words, i):
            num_verbs += 1
            if num_subordinate == 0:
                return True
    return num_verbs > num_subordinate


def is_sentence(text):
    """True if the comment opens with a sentence."""
    if re.match(r"`?[\w.]+`?(, `?[\w.]+`?)*:\s", text) and not re.match(r"[A-Z][a-z]+:", text):
        return True  # describes a parameter
    sentence = first_sentence(text)
    words = words_of(sentence)
    if RESULTS.match(text) or starts_with_verb(words):
        return True
    if words and words[0] in ALWAYS_HALF:
        return False
    is_formula = re.search(r"\s(=|<-|->|<=|>=|-=|\+=|==)\s", sentence) and (
        not words or words[0] not in WORDS["openers"]
    )
    return bool(is_formula) or has_main_clause(words)


def opens_in_the_middle(text):
    """True if the comment begins as if a sentence had gone before: "Of the query", "The same without noise"."""
    words = words_of(first_sentence(text))
    if not words or is_sentence(text):
        return False
    return words[0] in WORDS["openers"] or words[:2] == ["the", "same"]
