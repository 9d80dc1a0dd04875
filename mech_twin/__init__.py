"""mech_twin: the digital twin of percussion and crank-linkage machines."""
