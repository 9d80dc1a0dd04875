# SPDX-License-Identifier: Apache-2.0
"""``mech-twin list``."""

from __future__ import annotations

from mech_twin.cli.console import print_json, print_table
from mech_twin.cli.verbs import ListVerb
from mech_twin.machines.catalog import CATALOGUE


def show_catalogue(asked: ListVerb) -> None:
    """Print the names and titles of all machines."""
    if asked.as_json:
        print_json({"machines": [{"name": e.name, "title": e.title} for e in CATALOGUE.values()]})
    else:
        print_table("machines", ("name", "description"), [(e.name, e.title) for e in CATALOGUE.values()])
