"""Files written whole or not at all, and read with a limit: text, TOML, JSON, CSV.

A file that cannot be read or written is a `StoopError` that names it.
"""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
