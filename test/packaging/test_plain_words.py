# SPDX-License-Identifier: Apache-2.0
"""The check of plain words finds long sentences, words to avoid and subjects that are no imperative."""

from __future__ import annotations

from pathlib import Path

import pytest
from ci_scripts import ci_script

CHECK = ci_script("plain_words")
LONG = "The crank " + "turns and " * 20 + "stops."


@pytest.mark.parametrize(
    ("name", "text", "count"),
    [
        ("page.md", LONG, 1),
        ("page.md", f"- {LONG}\n\n| a | {LONG} |\n", 2),
        ("page.md", "The crank turns. " * 20, 0),
        ("page.md", f"```\n{LONG}\n```\n<!-- written by x -->\n| {LONG} |\n<!-- end of x -->\n", 0),
        ("page.md", "The crank turns, whence it stops.", 1),
        ("page.py", f'"""Short.\n\n{LONG}\n"""\n', 1),
        ("page.py", f"words = {LONG!r}\n", 0),
    ],
)
def test_prose_is_judged_sentence_by_sentence(tmp_path: Path, name: str, text: str, count: int) -> None:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    assert len([*CHECK.long_sentences(file), *CHECK.house_words(file)]) == count


@pytest.mark.parametrize("subject", ["Fix the gap", "Press the layer once", "Bring back the crank"])
def test_an_imperative_subject_passes(subject: str) -> None:
    assert CHECK.subject_faults(subject) == []


@pytest.mark.parametrize(
    "subject", ["Fixed the gap", "fix the gap", "Adds a gap", "The gap", "Fix " + "a gap " * 12, ""]
)
def test_any_other_subject_is_refused(subject: str) -> None:
    assert len(CHECK.subject_faults(subject)) == 1
