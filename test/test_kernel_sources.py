# SPDX-License-Identifier: Apache-2.0
"""What a kernel's module imports is found in the part of its source that is parsed."""

import ast
from pathlib import Path

import pytest

import mech_twin
from mech_twin.kernels.cache import _imports, _loaded_statements, _statements

FILES = sorted(Path(mech_twin.__file__).parent.rglob("*.py"))


def imports(body: list[ast.stmt]) -> list[str]:
    """Return the import statements that run when a module is loaded."""
    return [ast.unparse(x) for x in _loaded_statements(body) if isinstance(x, ast.Import | ast.ImportFrom)]


@pytest.mark.slow
def test_the_imports_of_each_file_are_those_of_the_parser() -> None:
    assert len(FILES) > 300
    for file in FILES:
        content = file.read_bytes()
        assert imports(_statements(content)) == imports(ast.parse(content).body), file


@pytest.mark.parametrize(
    "text",
    [
        "import a.b, c as d  # why\nfrom . import e\nfrom k import *\n",
        "from ..f.g import (\n    h,  # one\n    i as j,\n)\n",
        "from a import \\\n    b\nimport c; import d\n",
        "from a import (b,  # (with brackets)\n  c)\n",
        "try:\n    import a\nexcept ImportError:\n    import b\n",
        "if X:\n    import a\nelse:\n    from b import c\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import a\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import a\nelse:\n    import b\n",
        "class A:\n    x = 1\n\n    import b\n\n\ndef f():\n    import c\n",
        "class A:\n    def f(self):\n        import c\n",
        "class A:\n    if B:\n        import c\n",
        "import a\n\n\ndef f():\n    pass\n\n\nimport b\n",
        "import a\n\n\n@a\nclass B:\n    pass\n\n\ntry:\n    import b\nexcept ImportError:\n    pass\n",
        "with a:\n    import b\nfor c in d:\n    import e\n",
        '"""A page.\n\nimport a\nfrom the start import nothing, whatever it is\nfrom b import c\n"""\n',
        '"""A page.\n\nclass A of them\n"""\nimport a\n\n\ndef f():\n    pass\n',
    ],
)
def test_each_form_of_an_import_is_found(text: str) -> None:
    assert imports(_statements(text.encode())) == imports(ast.parse(text).body)


def test_names_are_resolved_within_the_package(tmp_path: Path) -> None:
    file = tmp_path / "inner.py"
    file.write_text("from . import a\nfrom ..b import c\nimport d.e\n")
    assert _imports("top.room.inner", file) == ("top.room", "top.room.a", "top.b", "top.b.c", "d.e")
