"""The version of jgait, in a module of its own: files that state it need not import the whole library."""

__version__ = "0.1.0"
