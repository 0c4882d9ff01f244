"""Findings as data: a code of ``data/notices.toml``, a severity, a subject, values. Sentences are formatted once."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
