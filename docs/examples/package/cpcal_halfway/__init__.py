"""A contractor, a strategy and an operation of a third party."""

from cpcal_halfway.operation import logsumexp

__all__ = ["logsumexp"]
