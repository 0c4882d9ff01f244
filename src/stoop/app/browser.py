"""The user's browser."""

from __future__ import annotations

import webbrowser


def open_address(address: str) -> bool:
    """Open an address in the user's browser; return whether there is one."""
    try:
        return webbrowser.open(address)
    except (webbrowser.Error, OSError):
        return False
