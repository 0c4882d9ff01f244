"""Drafts of mappings and of vehicle files."""
