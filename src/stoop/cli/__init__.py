"""The command line: one thin file per verb, which parses, calls and prints.

A verb is a module with ``add_arguments(parser)`` and ``run(arguments) -> int`` (the exit code). It imports
nothing heavy at its top, so that its ``--help`` is instant.
"""
