"""The mech-twin command, one file per verb."""
