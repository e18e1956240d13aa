"""The commands of `jgait`, one a file; `jgait.cli` puts them together. They need the extra `cli`."""
