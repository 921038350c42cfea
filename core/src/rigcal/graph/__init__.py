"""Pairs, the spanning tree and the global estimate."""
