"""rerun scenes."""
