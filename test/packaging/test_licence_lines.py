# SPDX-License-Identifier: Apache-2.0
"""Every source file names its licence, which is that of the package."""

from __future__ import annotations

from pathlib import Path

from ci_scripts import ci_script

ROOT = Path(__file__).resolve().parents[2]


LINES = ci_script("licence_lines")


def test_every_source_file_names_the_licence() -> None:
    files = list(LINES.sources())
    assert len(files) > 500
    assert [str(file.relative_to(ROOT)) for file in files if not LINES.has_line(file)] == []


def test_the_licence_is_that_of_the_package() -> None:
    assert f'license="{LINES.LICENCE}"' in (ROOT / "setup.py").read_text(encoding="utf-8")
    assert f"<license>{LINES.LICENCE}</license>" in (ROOT / "package.xml").read_text(encoding="utf-8")
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert "Apache License" in text[:200]
    assert "Version 2.0" in text[:200]


def test_a_line_is_added_below_one_for_the_shell_and_once(tmp_path: Path) -> None:
    program, module = tmp_path / "program.sh", tmp_path / "module.py"
    program.write_text("#!/bin/sh\necho\n", encoding="utf-8")
    module.write_text('"""What it is."""\n', encoding="utf-8")
    for file in (program, module):
        assert not LINES.has_line(file)
        LINES.add_line(file)
        assert LINES.has_line(file)
    assert program.read_text(encoding="utf-8") == f"#!/bin/sh\n{LINES.line_of(program)}\necho\n"
    assert module.read_text(encoding="utf-8") == f'{LINES.line_of(module)}\n"""What it is."""\n'
