"""One package a machine, what several share, and the catalogue."""
