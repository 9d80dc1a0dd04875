# SPDX-License-Identifier: Apache-2.0
"""Hybrid dynamics: one force law for contact, friction and stops, and one event loop for every machine."""
