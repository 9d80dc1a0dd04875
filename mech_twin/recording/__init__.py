"""MCAP: write, read, replay, recover."""
