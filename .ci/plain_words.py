# SPDX-License-Identifier: Apache-2.0
"""Checks the prose of pages, docstrings, changelog fragments and commit subjects; exit code 1 for a fault.

Usage: plain_words.py          every file, and the subjects of commits since `SUBJECTS_SINCE`
       plain_words.py MESSAGE  the subject in a file, as the hook commit-msg hands it over
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST_WORDS = 40
MOST_WORDS_OF_A_CHANGE = 25
MOST_LETTERS_OF_A_SUBJECT = 72
SUBJECTS_SINCE = "2026-11-24T11:30:00Z"
HOUSE_WORDS = {
    "utilise": "use", "utilize": "use", "in order to": "to", "prior to": "before", "whence": "from which",
    "thereof": "of it", "wherein": "in which", "hitherto": "until now", "obviously": "nothing", "of course": "nothing",
    "borne out": "consistent", "tell nobody": "discard", "at its word": "the term of the field", "seamless": "how",
}  # fmt: skip
ABBREVIATION = re.compile(r"\b(e\.g|i\.e|cf|vs|etc|al|Fig|Figs|Eq|Eqs|No|pp|approx|ca|Sec|Ch|Vol)\.")
NOT_IMPERATIVE = re.compile(r"(?!(Bring|String|Embed|Need|Feed|Speed|Seed|Bleed|Shed|Wed)$)\w+(ing|ed|[^su]s)$")
NOT_A_VERB = {"A", "An", "The", "This", "It", "We", "I", "More", "New", "No", "Some", "All"}


def paragraphs(markdown: str) -> Iterator[str]:
    """Yield the blocks of a page that are prose: paragraphs, list items, cells of tables that no script writes."""
    text = re.sub(
        r"<!-- written by .*?<!-- end of .*?-->|^ *```.*?^ *```|<!--.*?-->", "\n", markdown, flags=re.S | re.M
    )
    text = re.sub(r"\$\$.*?\$\$|\\\[.*?\\\]", " x ", text, flags=re.S)
    text = re.sub(r"^( {4,}\S.*|#+ .*)$", "", text, flags=re.M)
    text = re.sub(r"^ *([-*]|\d+\.) ", "\n\n", text, flags=re.M)
    for block in re.split(r"\n\s*\n", text):
        table = block.lstrip().startswith("|")
        yield from (re.split(r"(?<!\\)\||\n", block) if table else [block])


def docstring_blocks(source: str) -> Iterator[str]:
    """Yield the paragraphs of each docstring; a change of indentation begins one, and figures are left out."""
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    for node in ast.walk(ast.parse(source)):
        text = (ast.get_docstring(node) or "") if isinstance(node, kinds) else ""
        block: list[str] = []
        indent = 0
        for line in [*text.splitlines(), ""]:
            own = len(line) - len(line.lstrip())
            if not line.strip() or own != indent or re.search(r"\S {3,}\S|^[-=~\s]+$", line):
                yield " ".join(block)
                block, indent = [], own
            block.append(line.strip())


def sentences(block: str) -> list[list[str]]:
    """Return the words of each sentence of a block; code and a formula are one word each."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"`+[^`]*`+|\$[^$]+\$", "code", block))
    text = ABBREVIATION.sub(r"\1", text)
    found = re.split(r"(?<=[.!?])[)\"*_]*\s+(?=[\"(*_]*[A-Z0-9`c])", text)
    return [re.findall(r"[^\W\d_][\w'-]*", sentence) for sentence in found]


def long_sentences(file: Path) -> list[str]:
    """Return a fault for each sentence that is too long."""
    text = file.read_text(encoding="utf-8")
    blocks = docstring_blocks(text) if file.suffix == ".py" else paragraphs(text)
    found = [words for block in blocks for words in sentences(block) if len(words) > MOST_WORDS]
    return [f"{len(words)} words in a sentence, at most {MOST_WORDS}: {' '.join(words[:9])} ..." for words in found]


def house_words(file: Path) -> list[str]:
    """Return a fault for each word that the house does not use."""
    text = file.read_text(encoding="utf-8")
    prose = " ".join(docstring_blocks(text) if file.suffix == ".py" else paragraphs(text)).lower()
    prose = re.sub(r"\s+", " ", prose)
    said = [word for word in HOUSE_WORDS if re.search(rf"\b{word}\b", prose)]
    return [f'"{word}": say {HOUSE_WORDS[word]}' for word in said]


def subject_faults(subject: str) -> list[str]:
    """Return what is wrong with the subject of a commit."""
    first = (subject.split() or [""])[0]
    letters = len(subject)
    imperative = first[:1].isupper() and first not in NOT_A_VERB and not NOT_IMPERATIVE.match(first)
    return [
        *([f"{letters} letters, at most {MOST_LETTERS_OF_A_SUBJECT}"] if letters > MOST_LETTERS_OF_A_SUBJECT else []),
        *([] if imperative else ["begin with a verb in the imperative, as in Add, Fix, Remove"]),
    ]


def faults() -> Iterator[str]:
    """Yield every fault of the tree."""
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    for file in sorted([*pages, *(file for room in ("mech_twin", ".ci") for file in (ROOT / room).rglob("*.py"))]):
        name = file.relative_to(ROOT).as_posix()
        yield from (f"{name}: {fault}" for fault in (*long_sentences(file), *house_words(file)))
    for file in sorted((ROOT / "changelog.d").glob("*.*.md")):
        for line in file.read_text(encoding="utf-8").splitlines():
            if len(line.split()) > MOST_WORDS_OF_A_CHANGE:
                yield f"changelog.d/{file.name}: {len(line.split())} words, at most {MOST_WORDS_OF_A_CHANGE}: {line}"
    log = ["git", "-C", str(ROOT), "log", "--no-merges", f"--since={SUBJECTS_SINCE}", "--format=%s"]
    for subject in subprocess.run(log, capture_output=True, text=True, check=False).stdout.splitlines():
        yield from (f"commit {subject!r}: {fault}" for fault in subject_faults(subject))


if __name__ == "__main__":
    message = Path(sys.argv[1]).read_text(encoding="utf-8").split("\n")[0] if sys.argv[1:] else None
    found = list(faults() if message is None else subject_faults(message))
    sys.stdout.writelines(f"{line}\n" for line in found)
    raise SystemExit(1 if found else 0)
