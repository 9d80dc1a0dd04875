# SPDX-License-Identifier: Apache-2.0
"""``python -m mech_twin`` is the ``mech-twin`` command."""

from mech_twin.programs import command

command()
