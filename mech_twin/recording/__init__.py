# SPDX-License-Identifier: Apache-2.0
"""MCAP: write, read, replay, recover."""
