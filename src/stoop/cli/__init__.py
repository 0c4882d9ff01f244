"""The command line: verbs parse, call and print.

A verb is a function of the parsed arguments that returns the exit code; a row of ``data/verbs.toml``, or of a package's
``stoop.toml``, names it and its options. Modules import nothing heavy at their top: ``--help`` is instant.
"""
