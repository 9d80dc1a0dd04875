"""Pure models of one thing each; no part knows another."""
