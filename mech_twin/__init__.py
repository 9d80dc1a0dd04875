"""mech_twin: the digital twin of percussion and crank-linkage machines."""

__version__ = "0.1.0"
