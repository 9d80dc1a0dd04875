# SPDX-License-Identifier: Apache-2.0
"""The spring-pressed body of a percussion mechanism: as published, and as the real machine needs it."""
