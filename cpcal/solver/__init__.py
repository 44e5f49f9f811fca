"""The constraint solver. It knows nothing of robots."""
