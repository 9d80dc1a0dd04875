# SPDX-License-Identifier: Apache-2.0
"""Pure models of one thing each; no part knows another."""
