# SPDX-License-Identifier: Apache-2.0
"""Text and values damaged at random, as an editor, a cut copy or another program may damage them."""

from __future__ import annotations

import copy
import random
from typing import Any

PIECES = (
    b"nan", b".nan", b".inf", b"-.inf", b"-1", b"0", b"0.0", b"1e308", b"1e-320", b"9" * 400, b"null", b"true",
    b"!!python/object:os.system", b"!!binary x", b"!!set {}", b"!!float x", b"!!int x", b"!!timestamp x", b"2001-99-99",
    b"2001-01-01", b"12:30:45", b"0x", b"0o9", b"&a", b"*a", b"<<: *a", b"[]", b"{}", b"[" * 50, b"{" * 50, b"'", b'"',
    b"\t", b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"---\n", b"? ", b": ", b"- ", b"=", b"#", b"%YAML 9.9\n",
    b"0x" + b"f" * 5000, b"1:" * 400 + b"1.5", b"\xe2\x80\xa8", b"/**:", b"ros__parameters:", b"run:\n",
    b"name: 4A71B6",
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


VALUES = (
    None, True, False, 0, -1, 2**63, -(2**70), 1e-320, 1e-30, -1e30, 1e31, 1e308, float("nan"), float("inf"), "", "a",
    "nan", "x" * 300, [], [0.0], [[]], [[1.0]], {}, {"a": 1}, [None], [[[1.0]]], ["a"], 10**400,
)  # fmt: skip


def mutated_tree(tree: Any, chance: random.Random) -> Any:
    """Return a copy of nested dictionaries and lists with one to three places changed."""
    found = copy.deepcopy(tree)
    for _ in range(chance.randint(1, 3)):
        place = found
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = chance.choice(keys)
            if isinstance(place[key], dict | list) and chance.random() < 0.8:
                place = place[key]
                continue
            _change(place, key, chance)
            break
    return found


def _change(place: Any, key: Any, chance: random.Random) -> None:
    how = chance.randrange(6)
    if how == 0:
        del place[key]
    elif how == 1 and isinstance(place, list):
        place.insert(key, copy.deepcopy(chance.choice(place)))
    elif how == 2:
        place[key] = copy.deepcopy(place[chance.choice(list(place) if isinstance(place, dict) else range(len(place)))])
    elif how == 3 and isinstance(place[key], float):
        place[key] *= chance.choice((-1.0, 0.0, 1e-12, 1e12, 3.0))
    else:
        place[key] = copy.deepcopy(chance.choice(VALUES))
