# SPDX-License-Identifier: Apache-2.0
"""Export of a machine as a functional mock-up unit (FMI 2.0 and 3.0, co-simulation) that needs no Python."""
