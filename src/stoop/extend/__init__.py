"""The interface for packages: names that they may build on, in groups, each a module that imports them at the first use.

A package imports `stoop`, these groups, and packages below it. The stub of a group (``.pyi``) lists its names.
"""
