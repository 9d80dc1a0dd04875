# SPDX-License-Identifier: Apache-2.0
"""Display of runs: rerun recordings, and the bench in a browser."""
