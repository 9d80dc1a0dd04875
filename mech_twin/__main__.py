"""``python -m mech_twin`` is the ``mech-twin`` command."""

from mech_twin.cli.main import main

main()
