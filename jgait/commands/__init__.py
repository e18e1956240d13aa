"""The commands of `jgait`, one in each file; `jgait.cli` combines them. They need the extra `cli`."""
