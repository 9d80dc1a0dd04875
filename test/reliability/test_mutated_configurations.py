# SPDX-License-Identifier: Apache-2.0
"""A configuration that was damaged is parameters or a ConfigurationError, never anything else."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from catalogue import NAMES

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.parameters.load import catalogue_entry, configuration_file, machine_parameters

pytestmark = pytest.mark.slow

MUTATIONS = 1000
PIECES = (
    b"nan", b".nan", b".inf", b"-.inf", b"-1", b"0", b"0.0", b"1e308", b"1e-320", b"9" * 400, b"null", b"true",
    b"!!python/object:os.system", b"!!binary x", b"!!set {}", b"!!float x", b"!!int x", b"!!timestamp x", b"2001-99-99",
    b"2001-01-01", b"12:30:45", b"0x", b"0o9", b"&a", b"*a", b"<<: *a", b"[]", b"{}", b"[" * 50, b"{" * 50, b"'", b'"',
    b"\t", b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"---\n", b"? ", b": ", b"- ", b"=", b"#", b"%YAML 9.9\n",
    b"\xe2\x80\xa8", b"/**:", b"ros__parameters:", b"run:\n", b"name: 4A71B6",
)  # fmt: skip


def mutated(content: bytes, chance: random.Random) -> bytes:
    """Return the file with one to four pieces changed."""
    data = bytearray(content)
    lines = content.split(b"\n")
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(data) + 1)
        how = chance.randrange(7)
        if how == 0:
            data[at:at] = chance.choice(PIECES)
        elif how == 1:
            data[at : at + chance.randint(1, 30)] = b""
        elif how == 2:
            data[at : at + 1] = bytes([chance.randrange(256)])
        elif how == 3:
            data[at:at] = chance.choice(lines) + b"\n"
        elif how == 4:
            del data[at:]
        else:  # another value for a key: the likeliest to pass the parser
            colons = [i for i, byte in enumerate(data) if byte == ord(":")]
            if colons:
                colon = chance.choice(colons)
                end = data.find(b"\n", colon)
                data[colon + 1 : end if end >= 0 else len(data)] = b" " + chance.choice(PIECES)
    return bytes(data)


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_configuration_is_parameters_or_a_configuration_error(name: str, tmp_path: Path) -> None:
    chance = random.Random(f"{name} configuration")
    content = configuration_file(name).read_bytes()
    refused = 0
    file = tmp_path / f"{name}.yaml"
    for _ in range(MUTATIONS):
        file.write_bytes(mutated(content, chance))
        try:
            parameters = machine_parameters(name, file)
        except ConfigurationError as error:
            assert str(error).startswith(str(file))
            refused += 1
        else:
            catalogue_entry(name).build(parameters)
    assert refused > MUTATIONS // 2
