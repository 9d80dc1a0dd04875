"""One file per machine, and the catalogue."""
