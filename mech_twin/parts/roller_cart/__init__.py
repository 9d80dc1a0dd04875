"""Roller forming carts on one crank shaft: parameters, kinematics, statics."""
