"""Records what a search proved and writes it as a certificate."""
