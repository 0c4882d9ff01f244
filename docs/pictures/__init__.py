"""The pictures of the documentation, drawn when it is built.

Each module but :mod:`.registry`, :mod:`.sketch` and :mod:`.directives` holds functions that draw pictures, from geometry
or by stoop itself. ``conf.py`` draws those whose files are missing or older than what they are made of.
"""
