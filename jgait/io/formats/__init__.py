"""File formats of measuring systems, one module each; `jgait.io.read` reads them all."""
