"""Time: the coupling scheme and the one-process run."""
