"""Certificates: proofs that a small program checks in exact arithmetic (docs/certificate-format.md)."""
