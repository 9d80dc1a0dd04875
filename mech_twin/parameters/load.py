"""YAML configuration -> validated parameter models.  The only place that reads configuration."""
