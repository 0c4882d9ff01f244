"""The command line: verbs parse, call and print.

A verb is a module with ``add_arguments(parser)`` and ``run(arguments) -> int`` (the exit code), or a function of a module
beside another that adds its arguments; see ``main.VERBS``. Modules import nothing heavy at their top: ``--help`` is instant.
"""
