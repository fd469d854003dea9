"""Processes that share a mesh."""
