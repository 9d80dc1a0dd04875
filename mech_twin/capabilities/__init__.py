# SPDX-License-Identifier: Apache-2.0
"""What a machine may answer beside running: the terms in which published values, sizes and plots are given."""
